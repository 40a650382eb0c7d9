//! `stockpilot inventory`: the books of halls.

use crate::change::OriginName;
use crate::logs;
use clap::{Args, Subcommand, ValueEnum};
use serde::Serialize;
use std::path::PathBuf;
use std::process::ExitCode;
use stockpilot::inventory::{AddOptions, Added, Inventory, history, history_table};
use stockpilot::mapping::change::USUAL_RISK;
use stockpilot::survey::Origin;

/// Options of `stockpilot inventory`.
#[derive(Debug, Args)]
pub(crate) struct InventoryArgs {
    /// The books: an SQLite file, made if it is not there.
    #[arg(long, value_name = "FILE", default_value = "stockpilot-books.sqlite")]
    books: PathBuf,
    #[command(subcommand)]
    command: InventoryCommand,
}

#[derive(Debug, Subcommand)]
enum InventoryCommand {
    /// Add surveys. One that is there already is not added again; if more was flown of it since, it is brought up to
    /// what the log says by now.
    Add {
        /// The logs, or what `merge` has written.
        #[arg(required = true, value_name = "LOG")]
        logs: Vec<PathBuf>,
        /// The hall that they measured.
        #[arg(long, value_name = "NAME")]
        hall: String,
        /// Which survey of the logs, from 1: each START that measures anew begins one. The last if left out.
        #[arg(long, value_name = "N")]
        flight: Option<usize>,
        /// Errors that these surveys do not share with earlier ones although the configurations are equal.
        #[arg(long, value_enum, value_delimiter = ',', value_name = "ORIGINS")]
        independent: Vec<OriginName>,
        /// Add what a person has rejected, too.
        #[arg(long)]
        although_rejected: bool,
    },
    /// The surveys.
    List {
        /// Of this hall only.
        #[arg(long, value_name = "NAME")]
        hall: Option<String>,
        /// Print one JSON array.
        #[arg(long)]
        json: bool,
    },
    /// What was in each bay, survey by survey, and what has changed since the newest one before that has it.
    History {
        /// Of this hall only.
        #[arg(long, value_name = "NAME")]
        hall: Option<String>,
        /// Of this bay only.
        #[arg(long, value_name = "NAME")]
        bay: Option<String>,
        /// How often noise may be called a change, for each line by itself.
        #[arg(long, default_value_t = USUAL_RISK)]
        risk: f64,
        /// Errors that no two surveys share although their configurations are equal.
        #[arg(long, value_enum, value_delimiter = ',', value_name = "ORIGINS")]
        independent: Vec<OriginName>,
        /// For people or for other programs.
        #[arg(long, value_enum, default_value_t = Form::Table)]
        form: Form,
    },
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Form {
    /// For people.
    Table,
    /// One array of objects.
    Json,
    /// A head and one row for each volume.
    Csv,
}

#[derive(Debug, Serialize)]
struct SurveyLine {
    survey_id: String,
    hall_id: String,
    hall: String,
    started_utc: Option<String>,
    bays: usize,
    build: String,
    log: PathBuf,
    log_sha256: String,
    /// Sums of the log when less was flown of the survey.
    replaced_log_sha256: Vec<String>,
    /// What a person had decided of it when its log was last added.
    decision: Option<String>,
    /// Which survey of the log; not known of some that an earlier program added.
    number: Option<usize>,
}

pub(crate) fn run(args: &InventoryArgs) -> anyhow::Result<ExitCode> {
    let mut books = Inventory::open(&args.books)?;
    match &args.command {
        InventoryCommand::Add { logs, hall, flight, independent, although_rejected } => {
            let options = AddOptions {
                number: *flight,
                although_rejected: *although_rejected,
                independent: independent.iter().map(|name| (*name).into()).collect(),
            };
            add(&mut books, hall, logs, &options)?;
        }
        InventoryCommand::List { hall, json } => list(&books, hall.as_deref(), *json)?,
        InventoryCommand::History { hall, bay, risk, independent, form } => {
            let independent: Vec<Origin> = independent.iter().map(|name| (*name).into()).collect();
            let surveys = books.surveys(hall.as_deref())?;
            let lines = history(&surveys, bay.as_deref(), *risk, &independent);
            print_history(&lines, *form)?;
        }
    }
    Ok(ExitCode::SUCCESS)
}

#[expect(clippy::print_stdout, reason = "the program's output")]
fn add(
    books: &mut Inventory,
    hall: &str,
    logs: &[PathBuf],
    options: &AddOptions,
) -> anyhow::Result<()> {
    let mut n_failed = 0;
    for log in logs {
        let added = match books.add(hall, log, options) {
            Ok(added) => added,
            // The others are no worse for it.
            Err(error) if logs.len() > 1 => {
                tracing::error!(log = %log.display(), "not added: {error}");
                n_failed += 1;
                continue;
            }
            Err(error) => return Err(error.into()),
        };
        let (id, place, what) = match added {
            Added::New { id, place } => (id, place, "added"),
            Added::Known { id, place } => (id, place, "there already"),
            Added::Updated { id, place } => (id, place, "more was flown: brought up to date"),
        };
        logs::tell_others(&place, "--flight");
        println!("{}: {what} as {id}", log.display());
    }
    anyhow::ensure!(n_failed == 0, "{n_failed} of {} logs were not added", logs.len());
    Ok(())
}

#[expect(clippy::print_stdout, reason = "the program's output")]
fn list(books: &Inventory, hall: Option<&str>, as_json: bool) -> anyhow::Result<()> {
    let surveys = books.surveys(hall)?;
    let lines: Vec<SurveyLine> = surveys
        .into_iter()
        .map(|stored| SurveyLine {
            survey_id: stored.id,
            hall_id: stored.hall_id,
            hall: stored.hall,
            started_utc: stored.started_utc,
            bays: stored.survey.accounts.len(),
            build: stored.build,
            log: stored.survey.path,
            log_sha256: stored.log_sha256,
            replaced_log_sha256: stored.replaced_sha256,
            decision: stored.decision,
            number: stored.number,
        })
        .collect();
    if as_json {
        println!("{}", serde_json::to_string(&lines)?);
        return Ok(());
    }
    for line in &lines {
        let when = line.started_utc.as_deref().unwrap_or("time unknown");
        let decision = line.decision.as_deref().map(|said| format!("  {said}")).unwrap_or_default();
        println!("{}  {when}  {}  {}{decision}", line.survey_id, line.hall, line.log.display());
    }
    Ok(())
}

#[expect(clippy::print_stdout, reason = "the program's output")]
fn print_history(lines: &[stockpilot::inventory::HistoryLine], form: Form) -> anyhow::Result<()> {
    match form {
        Form::Table => print!("{}", history_table(lines)),
        Form::Json => println!("{}", serde_json::to_string(lines)?),
        Form::Csv => {
            let mut writer = csv::Writer::from_writer(std::io::stdout());
            lines.iter().try_for_each(|line| writer.serialize(line))?;
            writer.flush()?;
        }
    }
    Ok(())
}
