//! Packing.

use super::key::{AuditKey, boxed};
use super::wishes::PackedWishes;
use super::{
    AuditError, CONFIG, EARLIER, PUBLIC_KEY, RECOMPUTE, SIGNATURE, SUMS, VOLUMES, WISHES, at,
};
use crate::export::{sha256_of_bytes, sha256_of_file};
use crate::messages::VolumeAccount;
use crate::record::{COMMIT_NOT_STAMPED, review_file};
use crate::report::{Facts, ReportFile, report_files, sync_folder, write_to_disk};
use crate::survey::Reproduction;
use serde::{Deserialize, Serialize};
use std::fs::File;
use std::path::Path;

/// The volumes of a pack, and the builds that agree on them.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PackedVolumes {
    /// The log's name in the pack.
    pub log: String,
    /// Version that flew.
    pub version: String,
    /// Build that flew.
    pub flown_with: String,
    /// Build that packed, and computed the same.
    pub packed_with: String,
    /// The volumes.
    pub volumes: Vec<PackedVolume>,
}

/// One volume to the last bit.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PackedVolume {
    /// What was measured.
    pub name: String,
    /// Volume, m³; the shortest number that reads back to the same bits.
    pub volume_m3: f64,
    /// Its standard deviation, m³.
    pub sigma_m3: f64,
    /// The bits of both, hexadecimal.
    pub bits: [String; 2],
}

impl From<&VolumeAccount> for PackedVolume {
    fn from(account: &VolumeAccount) -> Self {
        let (volume_m3, sigma_m3) = (account.estimate.volume_m3, account.estimate.sigma_m3);
        let bits = |value: f64| format!("{:016x}", value.to_bits());
        Self {
            name: account.name.clone(),
            volume_m3,
            sigma_m3,
            bits: [bits(volume_m3), bits(sigma_m3)],
        }
    }
}

/// What was packed.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Pack {
    /// Files in the list.
    pub n_files: usize,
    /// SHA-256 of the log.
    pub log_sha256: String,
}

/// Packs a survey into `folder`, which must not exist, and signs the list of its files. When it returns, all is
/// on the disk: the log may be deleted from then on. `log_sha256` is the log's sum before `facts` were read of it.
///
/// # Errors
/// A log that this build does not compute again to the last bit, a folder that exists, or a file that
/// cannot be written.
pub fn pack(
    facts: &Facts,
    log_sha256: &str,
    key: &AuditKey,
    folder: &Path,
) -> Result<Pack, AuditError> {
    let flight = &facts.flight;
    match flight.reproduction {
        Reproduction::Identical => {}
        Reproduction::Different => {
            return Err(AuditError::NotReproduced { flown_with: flight.build.clone() });
        }
        Reproduction::ResultsOnly => return Err(AuditError::Merged),
    }
    let log_name = flight.log.file_name().unwrap_or_default().to_string_lossy().into_owned();
    if log_name == EARLIER || !log_name.ends_with(".mcap") {
        return Err(AuditError::Name { name: log_name });
    }
    let wishes = PackedWishes::new(flight.place.number, &facts.wishes)?;
    let mut files = made_files(facts, log_sha256, &log_name)?;
    files.push((WISHES.to_owned(), json(&wishes)?));
    files.push((
        PUBLIC_KEY.to_owned(),
        format!("{}\n", boxed(&key.public)?.trim_end()).into_bytes(),
    ));
    let review = review_file(&flight.log);
    if review.is_file() {
        let name = review_file(Path::new(&log_name)).display().to_string();
        files.push((name, std::fs::read(&review).map_err(at(&review))?));
    }

    std::fs::create_dir(folder).map_err(at(folder))?;
    let mut sums = String::new();
    let mut list = |sum: &str, name: &str| sums.push_str(&format!("{sum}  {name}\n"));
    let clean_up = |_: &AuditError| drop(std::fs::remove_dir_all(folder));
    copy(&flight.log, &folder.join(&log_name), log_sha256).inspect_err(clean_up)?;
    list(log_sha256, &log_name);
    if let (Some(earlier), Some(packed)) = (&facts.wishes.against, &wishes.against) {
        copy(&earlier.path, &folder.join(EARLIER), &packed.sha256).inspect_err(clean_up)?;
        list(&packed.sha256, EARLIER);
    }
    for (name, bytes) in &files {
        list(&sha256_of_bytes(bytes), name);
        let path = folder.join(name);
        write_to_disk(&path, bytes).map_err(at(&path))?;
    }
    let signature = key.sign(sums.as_bytes(), &format!("stockpilot audit pack of {log_name}"))?;
    let n_files = sums.lines().count();
    for (name, text) in [(SUMS, sums), (SIGNATURE, signature)] {
        let path = folder.join(name);
        write_to_disk(&path, text.as_bytes()).map_err(at(&path))?;
    }
    sync_folder(folder).map_err(at(folder))?;
    Ok(Pack { n_files, log_sha256: log_sha256.to_owned() })
}

/// Copies a log to the disk; one that somebody writes meanwhile is no longer what was reported.
fn copy(log: &Path, to: &Path, sha256: &str) -> Result<(), AuditError> {
    std::fs::copy(log, to).map_err(at(to))?;
    File::open(to).and_then(|file| file.sync_all()).map_err(at(to))?;
    if sha256_of_file(to).map_err(at(to))? == sha256 {
        Ok(())
    } else {
        Err(AuditError::Growing { path: log.to_owned() })
    }
}

/// The files of a pack that can be made again from its logs, wishes and decisions.
pub(super) fn made_files(
    facts: &Facts,
    log_sha256: &str,
    log_name: &str,
) -> Result<Vec<(String, Vec<u8>)>, AuditError> {
    let mut files = vec![
        (CONFIG.to_owned(), facts.flight.config_toml.clone().into_bytes()),
        (VOLUMES.to_owned(), volumes(facts, log_name)?),
        (RECOMPUTE.to_owned(), commands(log_name, facts).into_bytes()),
    ];
    let report = report_files(facts, log_sha256)?;
    files.extend(report.into_iter().map(|ReportFile { name, bytes }| (name.to_owned(), bytes)));
    Ok(files)
}

fn json(of: &impl Serialize) -> Result<Vec<u8>, AuditError> {
    let mut json = serde_json::to_vec_pretty(of)?;
    json.push(b'\n');
    Ok(json)
}

fn volumes(facts: &Facts, log_name: &str) -> Result<Vec<u8>, AuditError> {
    let flight = &facts.flight;
    json(&PackedVolumes {
        log: log_name.to_owned(),
        version: flight.version.clone(),
        flown_with: flight.build.clone(),
        packed_with: facts.reported_by.clone(),
        volumes: flight.accounts.iter().map(PackedVolume::from).collect(),
    })
}

fn commands(log_name: &str, facts: &Facts) -> String {
    let packed_with = &facts.reported_by;
    let source = if packed_with.contains(COMMIT_NOT_STAMPED) {
        "The commit of the source is not stamped into the build, so the signer must name it"
    } else {
        "The commit of the source is the one in the build's name"
    };
    format!(
        "With stockpilot {packed_with}, which has made the pack, on a processor of the same family, in this folder:\n\n\
         \x20   stockpilot audit verify . --public-key KEY.pub\n\n\
         checks the signature and every file, computes the volumes again to the last bit, and makes every file of \
         the report anew. On the signature alone stand: the configuration of the log, {WISHES} with the \
         books, the decisions on the flight, and {EARLIER}. Another build may not come to the same; it ends with 3 \
         or 4 then, which says nothing of the pack. Step by step:\n\n\
         \x20   minisign -V -p KEY.pub -m {SUMS}          the list is signed\n\
         \x20   sha256sum --check {SUMS}                   every file is as listed\n\
         \x20   stockpilot replay {log_name} --verify      every result of the flight again\n\n\
         KEY.pub must come from the signer, not from this folder. {source}: cargo build --release --locked -p \
         stockpilot, then target/release/stockpilot.\n",
    )
}
