//! Packing.

use super::key::{AuditKey, boxed};
use super::{
    AuditError, CONFIG, PUBLIC_KEY, RECOMPUTE, SIGNATURE, SUMS, VOLUMES, at, minisign_error,
};
use crate::export::{sha256_of_bytes, sha256_of_file};
use crate::messages::VolumeAccount;
use crate::record::build_identity;
use crate::report::{Facts, ReportFile, report_files};
use crate::survey::{Flight, Reproduction};
use serde::{Deserialize, Serialize};
use std::fmt::Write as _;
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

/// Packs a survey into `folder`, which must not exist, and signs the list of its files.
///
/// # Errors
/// A log that this build does not compute again to the last bit, a folder that exists, or a file that
/// cannot be written.
pub fn pack(facts: &Facts, key: &AuditKey, folder: &Path) -> Result<Pack, AuditError> {
    let flight = &facts.flight;
    match flight.reproduction {
        Reproduction::Identical => {}
        Reproduction::Different => {
            return Err(AuditError::NotReproduced { flown_with: flight.build.clone() });
        }
        Reproduction::ResultsOnly => return Err(AuditError::Merged),
    }
    let log_sha256 = sha256_of_file(&flight.log).map_err(at(&flight.log))?;
    let log_name = flight.log.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let volumes = volumes(flight, &log_name)?;
    let mut files: Vec<(&str, Vec<u8>)> = vec![
        (CONFIG, flight.config_toml.clone().into_bytes()),
        (VOLUMES, volumes),
        (RECOMPUTE, commands(&log_name, flight).into_bytes()),
        (PUBLIC_KEY, format!("{}\n", boxed(&key.public)?.trim_end()).into_bytes()),
    ];
    let report = report_files(facts, &log_sha256)?;
    files.extend(report.into_iter().map(|ReportFile { name, bytes }| (name, bytes)));

    std::fs::create_dir(folder).map_err(at(folder))?;
    let copy = folder.join(&log_name);
    std::fs::copy(&flight.log, &copy).map_err(at(&copy))?;
    let mut sums = format!("{log_sha256}  {log_name}\n");
    for (name, bytes) in &files {
        // Writing into a text cannot fail.
        let _ok = writeln!(sums, "{}  {name}", sha256_of_bytes(bytes));
        let path = folder.join(name);
        std::fs::write(&path, bytes).map_err(at(&path))?;
    }
    let signature = minisign::sign(
        Some(&key.public),
        &key.secret,
        sums.as_bytes(),
        Some(&format!("stockpilot audit pack of {log_name}")),
        Some("minisign signature of SHA256SUMS"),
    )
    .map_err(minisign_error("signing"))?;
    for (name, text) in [(SUMS, sums), (SIGNATURE, signature.into_string())] {
        let path = folder.join(name);
        std::fs::write(&path, text).map_err(at(&path))?;
    }
    Ok(Pack { n_files: files.len() + 1, log_sha256 })
}

fn volumes(flight: &Flight, log_name: &str) -> Result<Vec<u8>, AuditError> {
    let packed = PackedVolumes {
        log: log_name.to_owned(),
        version: flight.version.clone(),
        flown_with: flight.build.clone(),
        packed_with: build_identity(),
        volumes: flight.accounts.iter().map(PackedVolume::from).collect(),
    };
    let mut json = serde_json::to_vec_pretty(&packed)?;
    json.push(b'\n');
    Ok(json)
}

fn commands(log_name: &str, flight: &Flight) -> String {
    format!(
        "With stockpilot {} of the same source (build of the pack: {}), in this folder:\n\n\
         \x20   stockpilot audit verify . --public-key KEY.pub\n\n\
         checks the signature and every file, and computes the volumes again to the last bit. Step by \
         step:\n\n\
         \x20   minisign -V -p KEY.pub -m {SUMS}          the list is signed\n\
         \x20   sha256sum --check {SUMS}                   every file is as listed\n\
         \x20   stockpilot replay {log_name} --verify      every result of the flight again\n\n\
         KEY.pub must come from the signer, not from this folder. The program from its source, at the commit \
         that the build names: cargo build --release --locked -p stockpilot, then target/release/stockpilot.\n",
        flight.version,
        build_identity()
    )
}
