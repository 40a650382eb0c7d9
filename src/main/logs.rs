//! `stockpilot logs`: what the folder with the logs holds, and what may go.

use anyhow::Context as _;
use clap::{Args, Subcommand};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use stockpilot::record::{
    Seen, Standing, SurveyPlace, mark_reported, shelved_logs, standing_within,
};

/// Options of `stockpilot logs`.
#[derive(Debug, Args)]
pub(crate) struct LogsArgs {
    #[command(subcommand)]
    command: LogsCommand,
}

#[derive(Debug, Subcommand)]
enum LogsCommand {
    /// Every log, the oldest first, with what is known of it.
    List {
        /// The folder.
        #[arg(default_value = "logs")]
        folder: PathBuf,
        /// Print one JSON array.
        #[arg(long)]
        json: bool,
    },
    /// Let logs go when the disk fills, because they lie somewhere else too.
    Release {
        /// The logs.
        #[arg(required = true, value_name = "LOG")]
        logs: Vec<PathBuf>,
    },
}

#[expect(clippy::print_stdout, reason = "the program's output")]
pub(crate) fn run(args: &LogsArgs) -> anyhow::Result<ExitCode> {
    match &args.command {
        LogsCommand::List { folder, json } => {
            let mut logs = shelved_logs(folder)
                .with_context(|| format!("cannot read {}", folder.display()))?;
            for log in logs.iter_mut().filter(|log| log.standing == Standing::Kept) {
                log.standing = standing_within(&log.path)?;
            }
            if *json {
                println!("{}", serde_json::to_string(&logs)?);
                return Ok(ExitCode::SUCCESS);
            }
            for log in &logs {
                let megabytes = log.bytes.div_ceil(1_000_000);
                println!("{megabytes:6} MB  {:<38} {}", word(log.standing), log.path.display());
            }
        }
        LogsCommand::Release { logs } => {
            for log in logs {
                anyhow::ensure!(log.is_file(), "there is no log {}", log.display());
                mark_reported(log, "released")
                    .with_context(|| format!("cannot mark {}", log.display()))?;
            }
        }
    }
    Ok(ExitCode::SUCCESS)
}

const fn word(standing: Standing) -> &'static str {
    match standing {
        Standing::Empty => "nobody took off; may be deleted",
        Standing::Reported => "all reported; may be deleted",
        Standing::Kept => "a survey to report; is never deleted",
    }
}

/// Says that a log holds more surveys than the one that something is made of, and which option picks another.
pub(crate) fn tell_others(place: &SurveyPlace, option: &str) {
    if place.n_in_log > 1 {
        tracing::warn!(
            "the log holds {} surveys; this is number {}: {option} picks another",
            place.n_in_log,
            place.number
        );
    }
}

/// Looks into a log before something is made of it, so that what is flown meanwhile is not taken for reported;
/// `None` where it cannot be read, which whoever makes something of it will say.
pub(crate) fn seen(log: &Path) -> Option<Seen> {
    Seen::look(log).ok()
}

/// Remembers beside the log that something was made of one of its surveys. Logs are also read where nothing can
/// be written: then they are simply kept.
pub(crate) fn remember(seen: Option<&Seen>, what: &str, number: usize) {
    let Some(seen) = seen else { return };
    match seen.mark(what, number) {
        Ok(true) => {}
        Ok(false) => tracing::info!(
            n_surveys = seen.n_surveys(),
            number,
            "the log holds more than was reported, so it is kept"
        ),
        Err(error) => tracing::warn!(%error, "not marked as reported, so the log is kept"),
    }
}

/// Remembers that all of the log lies elsewhere too.
pub(crate) fn remember_all(seen: Option<&Seen>, what: &str) {
    if let Some(Err(error)) = seen.map(|seen| seen.mark_all(what)) {
        tracing::warn!(%error, "not marked as packed, so the log is kept");
    }
}
