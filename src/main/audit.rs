//! `stockpilot audit`: packs that others can compute again.

use crate::logs;
use crate::report::{SurveyArgs, facts_of};
use clap::{Args, Subcommand};
use std::path::PathBuf;
use std::process::ExitCode;
use stockpilot::audit::{
    AuditKey, Judgement, Verification, make_key, pack, read_public_key, verify,
};
use stockpilot::record::build_commit;

/// Options of `stockpilot audit`.
#[derive(Debug, Args)]
pub(crate) struct AuditArgs {
    #[command(subcommand)]
    command: AuditCommand,
}

/// How `audit verify` ends.
const EXIT_CODES: &str = "\
Ends with the first of these that holds:
  1  something is not as it was packed, or cannot be read
  2  all that could be checked is, but nobody says who signed
  3  the files are as they were signed, but this is another build than the one that has made the pack, and it does
     not come to the volumes or cannot read them: whether they are right, only the pack's build can say
  4  the volumes come out to the last bit, but this is another build than the pack's and makes another report
  0  files, volumes and report are as they were packed; by another build, too, if it comes to the same";

#[derive(Debug, Subcommand)]
enum AuditCommand {
    /// Make a key to sign with; its public half lies beside it, with the ending .pub.
    Key {
        /// The file of the secret half; it must not exist.
        file: PathBuf,
    },
    /// Pack a survey with all that somebody needs to compute it again, and sign it.
    Pack {
        #[command(flatten)]
        survey: Box<SurveyArgs>,
        /// The folder; it must not exist.
        #[arg(long, value_name = "DIR")]
        out: PathBuf,
        /// The secret key to sign with.
        #[arg(long, value_name = "FILE")]
        key: PathBuf,
    },
    /// Check a pack: signature, every file, the volumes, computed again to the last bit, and the report, made again
    /// to the last byte.
    #[command(after_help = EXIT_CODES)]
    Verify {
        /// The pack.
        folder: PathBuf,
        /// The signer's public key, which must come from the signer and not with the pack.
        #[arg(long, value_name = "FILE")]
        public_key: Option<PathBuf>,
        /// Be content with the key that lies in the pack: it says that nothing was changed since somebody signed,
        /// not who.
        #[arg(long, conflicts_with = "public_key")]
        packed_key: bool,
    },
}

#[expect(clippy::print_stdout, reason = "the program's output")]
pub(crate) fn run(args: &AuditArgs) -> anyhow::Result<ExitCode> {
    match &args.command {
        AuditCommand::Key { file } => {
            let public = make_key(file)?;
            println!("secret: {}; give to auditors: {}", file.display(), public.display());
        }
        AuditCommand::Pack { survey, out, key } => {
            let key = AuditKey::read(key)?;
            if build_commit().is_none() {
                tracing::warn!(
                    "commit not stamped: whoever checks the pack must be told the source of this program \
                     (STOCKPILOT_COMMIT in the environment of the build stamps it)"
                );
            }
            let seen = logs::seen(&survey.log);
            let (facts, log_sha256) = facts_of(survey)?;
            let packed = pack(&facts, &log_sha256, &key, out)?;
            // The pack has the whole log, with all its surveys.
            logs::remember_all(seen.as_ref(), "audit pack");
            println!("{}: {} files, log {}", out.display(), packed.n_files, packed.log_sha256);
        }
        AuditCommand::Verify { folder, public_key, packed_key } => {
            let key = public_key.as_deref().map(read_public_key).transpose()?;
            let found = verify(folder, key.as_ref())?;
            print_verification(&found);
            let nobody = found.key_is_from_pack && !packed_key;
            if found.key_is_from_pack {
                println!("the key is the pack's own: anybody may have signed");
            }
            if nobody {
                println!(
                    "NOT VERIFIED: give the signer's key by --public-key, or --packed-key to do without"
                );
            }
            return Ok(ExitCode::from(code(found.judgement(), nobody)));
        }
    }
    Ok(ExitCode::SUCCESS)
}

/// How `audit verify` ends, as its help says: the first that holds.
const fn code(judgement: Judgement, nobody_signed: bool) -> u8 {
    match (judgement, nobody_signed) {
        (Judgement::Differs, _) => 1,
        (_, true) => 2,
        (Judgement::Equal, _) => 0,
        (Judgement::VolumesNotJudged, _) => 3,
        (Judgement::ReportNotJudged, _) => 4,
    }
}

#[expect(clippy::print_stdout, reason = "the program's output")]
fn print_verification(found: &Verification) {
    let judgement = found.judgement();
    let mark = if judgement == Judgement::Differs { "BAD" } else { "OPEN" };
    for finding in &found.findings {
        println!("{mark}: {finding}");
    }
    println!("{} files are as they were packed", found.n_files);
    for volume in found.volumes.iter().flat_map(|packed| &packed.volumes) {
        println!("{}: {} m³, computed again to the last bit", volume.name, volume.volume_m3);
    }
    if found.volumes.is_some() {
        println!("every file of the report is what this build makes of the log, byte by byte");
    }
    if found.is_other_build() {
        let packed_with = found.packed_with.as_deref().unwrap_or("a build that is not known");
        println!("made with {packed_with}; this is {}", found.verified_with);
    }
    if found.may_be_a_namesake() {
        println!("the commit is not stamped into this build: another one may bear the same name");
    }
    println!("{}", said(judgement, found.is_reproduced));
}

/// The judgement in words.
const fn said(judgement: Judgement, is_reproduced: bool) -> &'static str {
    match (judgement, is_reproduced) {
        (Judgement::Equal, _) => "EQUAL: volumes to the last bit, report to the last byte",
        (Judgement::Differs, true) => {
            "DIFFERS: the volumes come out to the last bit, the report is another"
        }
        (Judgement::Differs, false) => "DIFFERS: something is not as it was packed",
        (Judgement::VolumesNotJudged, _) => {
            "NOT JUDGED: another build than the pack's does not come to its volumes, which says nothing of them: \
             check with the build that has made it"
        }
        (Judgement::ReportNotJudged, _) => {
            "VOLUMES EQUAL to the last bit; REPORT NOT JUDGED: another build than the pack's makes another one, which \
             says nothing of it: check with the build that has made it"
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::CommandFactory as _;

    #[derive(Debug, clap::Parser)]
    struct Cli {
        #[command(flatten)]
        audit: AuditArgs,
    }

    /// The help is what scripts are written by.
    #[test]
    fn every_exit_code_of_verify_stands_in_its_help() {
        let mut cli = Cli::command();
        let verify = cli.find_subcommand_mut("verify").expect("the command");
        let help = verify.render_long_help().to_string();
        let ends = [
            (Judgement::Equal, false, "0  "),
            (Judgement::Differs, false, "1  "),
            (Judgement::Differs, true, "1  "),
            (Judgement::Equal, true, "2  "),
            (Judgement::VolumesNotJudged, true, "2  "),
            (Judgement::VolumesNotJudged, false, "3  "),
            (Judgement::ReportNotJudged, false, "4  "),
        ];
        for (judgement, nobody_signed, line) in ends {
            assert_eq!(format!("{}  ", code(judgement, nobody_signed)), line, "{judgement:?}");
            assert!(help.contains(&format!("\n  {line}")), "{line:?} is not in {help}");
        }
    }
}
