//! `stockpilot audit`: packs that others can compute again.

use crate::logs;
use crate::report::{SurveyArgs, facts_of};
use clap::{Args, Subcommand};
use std::path::PathBuf;
use std::process::ExitCode;
use stockpilot::audit::{AuditKey, make_key, pack, read_public_key, verify};
use stockpilot::record::build_commit;

/// Options of `stockpilot audit`.
#[derive(Debug, Args)]
pub(crate) struct AuditArgs {
    #[command(subcommand)]
    command: AuditCommand,
}

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
    /// to the last byte. Ends with 1 if something is not as it was packed, with 2 if nobody says who signed.
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
            for finding in &found.findings {
                println!("BAD: {finding}");
            }
            println!("{} files are as they were packed", found.n_files);
            for volume in found.volumes.iter().flat_map(|packed| &packed.volumes) {
                println!(
                    "{}: {} m³, computed again to the last bit",
                    volume.name, volume.volume_m3
                );
            }
            if found.volumes.is_some() {
                println!(
                    "every file of the report is what this build makes of the log, byte by byte"
                );
            }
            let nobody = found.key_is_from_pack && !packed_key;
            if found.key_is_from_pack {
                println!("the key is the pack's own: anybody may have signed");
            }
            if nobody {
                println!(
                    "NOT VERIFIED: give the signer's key by --public-key, or --packed-key to do without"
                );
            }
            let code = if found.findings.is_empty() { 2 * u8::from(nobody) } else { 1 };
            return Ok(ExitCode::from(code));
        }
    }
    Ok(ExitCode::SUCCESS)
}
