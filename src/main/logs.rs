//! `stockpilot logs`: what the folder with the logs holds, and what may go.

use anyhow::Context as _;
use clap::{Args, Subcommand};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use stockpilot::record::{Standing, has_flown, mark_reported, shelved_logs};

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
                if !has_flown(&log.path)? {
                    log.standing = Standing::Empty;
                }
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
        Standing::Reported => "reported; may be deleted",
        Standing::Kept => "a survey to report; is never deleted",
    }
}

/// Remembers beside the log that something was made of it. Logs are also read where nothing can be
/// written: then they are simply kept.
pub(crate) fn remember(log: &Path, what: &str) {
    if let Err(error) = mark_reported(log, what) {
        tracing::warn!(%error, log = %log.display(), "not marked as reported, so it is kept");
    }
}
