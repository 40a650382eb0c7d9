//! `stockpilot report`.

use crate::change::OriginName;
use crate::logs;
use anyhow::Context;
use clap::Args;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use stockpilot::export::sha256_of_file;
use stockpilot::mapping::change::USUAL_RISK;
use stockpilot::report::{BookEntry, Facts, Target, Wishes, read_books, report_files, write_files};
use stockpilot::survey::{Flight, Survey};

/// A survey and what is to be said of it.
#[derive(Debug, Args)]
pub(crate) struct SurveyArgs {
    /// The log, or what `merge` has written.
    pub(crate) log: PathBuf,
    /// Which survey of the log, from 1: each START that measures anew begins one. The last if left out.
    #[arg(long, value_name = "N")]
    pub(crate) flight: Option<usize>,
    /// Log of an earlier survey of the same bays: the report says what has changed.
    #[arg(long, value_name = "LOG")]
    against: Option<PathBuf>,
    /// Which survey of the earlier log, which may then be the same log. The last if left out.
    #[arg(long, value_name = "N", requires = "against")]
    against_flight: Option<usize>,
    /// Errors that this survey and the earlier one do not share although their configurations are equal.
    #[arg(long, value_enum, value_delimiter = ',', value_name = "ORIGINS", requires = "against")]
    independent: Vec<OriginName>,
    /// The books: CSV with the columns `bay`, `volume_m3`, `mass_t`.
    #[arg(long, value_name = "FILE")]
    book: Option<PathBuf>,
    /// A line of the books, such as salt=660t or hall=412.5m3; may be given several times.
    #[arg(long, value_name = "BAY=AMOUNT")]
    book_of: Vec<BookEntry>,
    /// What the site is called.
    #[arg(long, value_name = "NAME")]
    site: Option<String>,
    /// What the hall is called in the books, for its id and those of its bays; the site's name if left out.
    #[arg(long, value_name = "NAME")]
    hall: Option<String>,
    /// Who flew.
    #[arg(long, value_name = "NAME")]
    operator: Option<String>,
    /// U (k = 2) that a volume may have, % of it.
    #[arg(long, value_name = "PERCENT", default_value_t = Target::default().percent)]
    target_percent: f64,
    /// How often noise may be called significant, for each line by itself.
    #[arg(long, default_value_t = USUAL_RISK)]
    risk: f64,
}

/// Options of `stockpilot report`.
#[derive(Debug, Args)]
pub(crate) struct ReportArgs {
    #[command(flatten)]
    survey: SurveyArgs,
    /// The folder for the files; made if it is not there.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
}

/// True if two paths lead to one file.
pub(crate) fn is_same_file(a: &Path, b: &Path) -> bool {
    matches!((a.canonicalize(), b.canonicalize()), (Ok(a), Ok(b)) if a == b)
}

/// The earlier survey to compare with.
fn earlier(args: &SurveyArgs) -> anyhow::Result<Option<Survey>> {
    let Some(against) = &args.against else { return Ok(None) };
    anyhow::ensure!(
        args.against_flight.is_some() || !is_same_file(against, &args.log),
        "{} is the log itself: --against-flight names an earlier survey of it",
        against.display()
    );
    let survey = Survey::read_one(against, args.against_flight)?;
    if args.against_flight.is_none() {
        logs::tell_others(&survey.place, "--against-flight");
    }
    Ok(Some(survey))
}

/// What a survey came to, and the SHA-256 of its log.
pub(crate) fn facts_of(args: &SurveyArgs) -> anyhow::Result<(Facts, String)> {
    let mut books = args.book.as_deref().map_or_else(|| Ok(Vec::new()), read_books)?;
    books.extend(args.book_of.iter().cloned());
    let wishes = Wishes {
        site: args.site.clone(),
        hall: args.hall.clone().or_else(|| args.site.clone()),
        operator: args.operator.clone(),
        target: Target { percent: args.target_percent, ..Target::default() },
        against: earlier(args)?,
        independent: args.independent.iter().map(|name| (*name).into()).collect(),
        books,
        risk: args.risk,
    };
    let sha256 =
        sha256_of_file(&args.log).with_context(|| format!("cannot read {}", args.log.display()))?;
    let flight = Flight::read_one(&args.log, args.flight)?;
    if let Some(against) = &wishes.against {
        anyhow::ensure!(
            !is_same_file(&against.path, &args.log) || against.place.number < flight.place.number,
            "survey {} of the log is not before survey {}: --against-flight must name an earlier one",
            against.place.number,
            flight.place.number
        );
    }
    logs::tell_others(&flight.place, "--flight");
    Ok((Facts::new(flight, wishes)?, sha256))
}

#[expect(clippy::print_stdout, reason = "the program's output")]
pub(crate) fn run(args: &ReportArgs) -> anyhow::Result<ExitCode> {
    let seen = logs::seen(&args.survey.log);
    let (facts, sha256) = facts_of(&args.survey)?;
    let files = report_files(&facts, &sha256)?;
    std::fs::create_dir_all(&args.out)
        .with_context(|| format!("cannot make {}", args.out.display()))?;
    write_files(&files, &args.out)?;
    logs::remember(seen.as_ref(), "report", facts.flight.place.number);
    for bay in &facts.bays {
        println!("{}: {}, {}", bay.account.name, bay.volume()?, bay.verdict.name());
    }
    for file in &files {
        println!("{}", args.out.join(file.name).display());
    }
    Ok(ExitCode::SUCCESS)
}
