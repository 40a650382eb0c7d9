//! `stockpilot audit`: packs that others can compute again.

use crate::logs;
use crate::report::{SurveyArgs, facts_of};
use clap::{Args, Subcommand};
use std::path::PathBuf;
use std::process::ExitCode;
use stockpilot::audit::{AuditKey, make_key, pack, read_public_key, verify};

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
        survey: SurveyArgs,
        /// The folder; it must not exist.
        #[arg(long, value_name = "DIR")]
        out: PathBuf,
        /// The secret key to sign with.
        #[arg(long, value_name = "FILE")]
        key: PathBuf,
    },
    /// Check a pack: signature, every file, and the volumes, computed again to the last bit.
    Verify {
        /// The pack.
        folder: PathBuf,
        /// The signer's public key. Without it the pack's own is taken: then nobody says who signed.
        #[arg(long, value_name = "FILE")]
        public_key: Option<PathBuf>,
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
            let (facts, _) = facts_of(survey)?;
            let packed = pack(&facts, &key, out)?;
            logs::remember(&survey.log, "audit pack");
            println!("{}: {} files, log {}", out.display(), packed.n_files, packed.log_sha256);
        }
        AuditCommand::Verify { folder, public_key } => {
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
            if found.key_is_from_pack {
                println!("the key is the pack's own: this does not say who signed");
            }
            return Ok(ExitCode::from(u8::from(!found.findings.is_empty())));
        }
    }
    Ok(ExitCode::SUCCESS)
}
