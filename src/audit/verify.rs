//! Checking a pack.

use super::pack::{PackedVolume, PackedVolumes, made_files};
use super::wishes::PackedWishes;
use super::{
    AuditError, CONFIG, EARLIER, PUBLIC_KEY, SIGNATURE, SUMS, VOLUMES, WISHES, at, read_public_key,
};
use crate::export::sha256_of_file;
use crate::record::{COMMIT_NOT_STAMPED, build_identity, review_file};
use crate::report::Facts;
use crate::survey::{Flight, Reproduction};
use minisign::{PublicKey, SignatureBox};
use std::collections::BTreeSet;
use std::fmt;
use std::path::Path;

/// Something that is not as it was packed.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Finding {
    /// The list is not signed by the key.
    BadSignature(String),
    /// The list is no list.
    BadList(String),
    /// A file of the list is not there or cannot be read.
    Missing(String),
    /// A file is not what was packed.
    Changed(String),
    /// A file is not in the list.
    Added(String),
    /// The log is flown with another configuration than the pack says.
    OtherConfiguration,
    /// The volumes are not those of the log, to the last bit.
    OtherVolumes(String),
    /// A file of the report is not what this build makes of the log and the wishes.
    NotMadeOfLog(String),
    /// A file is signed, but nothing that belongs to a pack.
    Foreign(String),
    /// This build makes a file of the log that the pack has not.
    Lacking(String),
    /// This build does not compute the recorded volumes again.
    NotReproduced(String),
    /// This build cannot read what was packed.
    Unreadable(String),
}

impl Finding {
    /// Another build than the one that has made the pack may find this without anything being wrong.
    const fn depends_on_build(&self) -> bool {
        match self {
            Self::NotMadeOfLog(_)
            | Self::Foreign(_)
            | Self::Lacking(_)
            | Self::NotReproduced(_)
            | Self::Unreadable(_) => true,
            Self::BadSignature(_)
            | Self::BadList(_)
            | Self::Missing(_)
            | Self::Changed(_)
            | Self::Added(_)
            | Self::OtherConfiguration
            | Self::OtherVolumes(_) => false,
        }
    }
}

impl fmt::Display for Finding {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::BadSignature(why) => write!(f, "{SUMS} is not signed by this key: {why}"),
            Self::BadList(line) => write!(f, "{SUMS}: {line:?} is no line of a list"),
            Self::Missing(name) => write!(f, "{name} is missing"),
            Self::Changed(name) => write!(f, "{name} is not what was packed"),
            Self::Added(name) => write!(f, "{name} was not packed"),
            Self::OtherConfiguration => write!(f, "{CONFIG} is not the log's configuration"),
            Self::OtherVolumes(name) => {
                write!(f, "{VOLUMES}: the volumes of {name} are not the log's")
            }
            Self::NotMadeOfLog(name) => {
                write!(f, "{name} is not what this build makes of the log and {WISHES}")
            }
            Self::Foreign(name) => write!(f, "{name} is signed, but no file of a pack"),
            Self::Lacking(name) => {
                write!(f, "{name}, which this build makes of the log, was not packed")
            }
            Self::Unreadable(why) => write!(f, "this build cannot read what was packed: {why}"),
            Self::NotReproduced(build) => {
                write!(
                    f,
                    "this build does not compute the same; it was flown with {build}, and another family of processors differs in the last digits"
                )
            }
        }
    }
}

/// What the check of a pack found.
#[derive(Debug, Clone, PartialEq)]
pub struct Verification {
    /// What is not as it was packed; empty if all is well.
    pub findings: Vec<Finding>,
    /// Files that are as they were packed.
    pub n_files: usize,
    /// The volumes, if they were computed again and came out to the last bit.
    pub volumes: Option<PackedVolumes>,
    /// The recorded volumes came out again to the last bit, whatever became of the report.
    pub is_reproduced: bool,
    /// The build that has made the pack, as far as this one can read that.
    pub packed_with: Option<String>,
    /// This build.
    pub verified_with: String,
    /// The key came from the pack itself: anybody may have signed it.
    pub key_is_from_pack: bool,
}

/// What can be said of a pack.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Judgement {
    /// Files, volumes and report are as they were packed.
    Equal,
    /// Something is not, and no difference between builds excuses it.
    Differs,
    /// The files are as they were signed, but another build than the pack's does not come to the volumes, or cannot
    /// read them: whether they are right, only the pack's build can say.
    VolumesNotJudged,
    /// The volumes came out to the last bit, but another build than the pack's makes another report of them.
    ReportNotJudged,
}

impl Verification {
    /// The pack was made by another build, or nobody can tell by which.
    #[must_use]
    pub fn is_other_build(&self) -> bool {
        self.packed_with.as_ref() != Some(&self.verified_with)
    }

    /// All that was found could come of another build that bears the same name: without a commit in it, names say
    /// little.
    #[must_use]
    pub fn may_be_a_namesake(&self) -> bool {
        !self.is_other_build()
            && self.verified_with.contains(COMMIT_NOT_STAMPED)
            && !self.findings.is_empty()
            && self.findings.iter().all(Finding::depends_on_build)
    }

    /// What can be said of the pack, but for who signed it.
    #[must_use]
    pub fn judgement(&self) -> Judgement {
        let is_excused = |finding: &Finding| finding.depends_on_build() && self.is_other_build();
        if self.findings.is_empty() {
            Judgement::Equal
        } else if !self.findings.iter().all(is_excused) {
            Judgement::Differs
        } else if self.is_reproduced {
            Judgement::ReportNotJudged
        } else {
            Judgement::VolumesNotJudged
        }
    }
}

/// Checks a pack: signature, every file, and the volumes and the report, made again from the log.
///
/// With a finding about the files nothing is computed: the log is not trusted. Without a public key
/// the pack's own is taken, which says that nothing was changed since the signing, not who signed.
///
/// # Errors
/// Files that cannot be read at all.
pub fn verify(folder: &Path, public_key: Option<&PublicKey>) -> Result<Verification, AuditError> {
    let own;
    let key = match public_key {
        Some(key) => key,
        None => {
            own = read_public_key(&folder.join(PUBLIC_KEY))?;
            &own
        }
    };
    let sums = read(folder, SUMS)?;
    let mut findings = Vec::new();
    if let Err(cause) = signed(folder, &sums, key)? {
        findings.push(Finding::BadSignature(cause));
    }
    let (listed, n_files) = check_files(folder, &sums, &mut findings);
    check_added(folder, &listed, &mut findings)?;
    let mut found = Verification {
        findings,
        n_files,
        volumes: None,
        is_reproduced: false,
        packed_with: packed_with(folder),
        verified_with: build_identity(),
        key_is_from_pack: public_key.is_none(),
    };
    if found.findings.is_empty() {
        match recompute(folder, &listed, &mut found) {
            Err(error @ AuditError::File { .. }) => return Err(error),
            Err(error) => found.findings.push(Finding::Unreadable(error.to_string())),
            Ok(volumes) => found.volumes = volumes,
        }
    }
    Ok(found)
}

/// The build that has made a pack. What else stands beside it, another build may not be able to read.
fn packed_with(folder: &Path) -> Option<String> {
    let volumes: serde_json::Value = serde_json::from_slice(&read(folder, VOLUMES).ok()?).ok()?;
    Some(volumes.get("packed_with")?.as_str()?.to_owned())
}

fn read(folder: &Path, name: &str) -> Result<Vec<u8>, AuditError> {
    let path = folder.join(name);
    std::fs::read(&path).map_err(at(&path))
}

fn signed(folder: &Path, sums: &[u8], key: &PublicKey) -> Result<Result<(), String>, AuditError> {
    let text = String::from_utf8_lossy(&read(folder, SIGNATURE)?).into_owned();
    let checked = SignatureBox::from_string(&text).and_then(|signature| {
        minisign::verify(key, &signature, std::io::Cursor::new(sums), true, false, false)
    });
    Ok(checked.map_err(|cause| cause.to_string()))
}

/// Checks the sums of all listed files; their names, and how many are right.
fn check_files(
    folder: &Path,
    sums: &[u8],
    findings: &mut Vec<Finding>,
) -> (BTreeSet<String>, usize) {
    let text = String::from_utf8_lossy(sums);
    let (mut listed, mut n_right) = (BTreeSet::new(), 0);
    for line in text.lines() {
        // A name with a path in it would reach out of the pack.
        let entry = line.split_once("  ").filter(|(_, name)| !name.contains(['/', '\0']));
        let Some((sum, name)) = entry else {
            findings.push(Finding::BadList(line.to_owned()));
            continue;
        };
        listed.insert(name.to_owned());
        match sha256_of_file(&folder.join(name)) {
            Ok(found) if found == sum => n_right += 1,
            Ok(_) => findings.push(Finding::Changed(name.to_owned())),
            Err(_) => findings.push(Finding::Missing(name.to_owned())),
        }
    }
    (listed, n_right)
}

fn check_added(
    folder: &Path,
    listed: &BTreeSet<String>,
    findings: &mut Vec<Finding>,
) -> Result<(), AuditError> {
    let mut names = BTreeSet::new();
    for entry in std::fs::read_dir(folder).map_err(at(folder))? {
        names.insert(entry.map_err(at(folder))?.file_name().to_string_lossy().into_owned());
    }
    let is_known = |name: &String| listed.contains(name) || name == SUMS || name == SIGNATURE;
    findings.extend(names.into_iter().filter(|name| !is_known(name)).map(Finding::Added));
    Ok(())
}

/// Flies the log again, makes every file anew, and compares to the last byte.
fn recompute(
    folder: &Path,
    listed: &BTreeSet<String>,
    found: &mut Verification,
) -> Result<Option<PackedVolumes>, AuditError> {
    let findings = &mut found.findings;
    for name in [VOLUMES, WISHES, CONFIG, PUBLIC_KEY] {
        if !listed.contains(name) {
            findings.push(Finding::Missing(name.to_owned()));
        }
    }
    if !findings.is_empty() {
        return Ok(None);
    }
    let packed: PackedVolumes = serde_json::from_slice(&read(folder, VOLUMES)?)?;
    let wishes: PackedWishes = serde_json::from_slice(&read(folder, WISHES)?)?;
    // Names in the list are files of the folder; any other name may lead out of it.
    let logs = [Some(packed.log.as_str()), wishes.against.as_ref().map(|_| EARLIER)];
    let absent = logs.into_iter().flatten().find(|name| !listed.contains(*name));
    if let Some(name) = absent {
        findings.push(Finding::Missing(name.to_owned()));
        return Ok(None);
    }
    let log = folder.join(&packed.log);
    let flight = Flight::read_one(&log, Some(wishes.flight))?;
    if flight.reproduction != Reproduction::Identical {
        findings.push(Finding::NotReproduced(flight.build.clone()));
    }
    if read(folder, CONFIG)? != flight.config_toml.as_bytes() {
        findings.push(Finding::OtherConfiguration);
    }
    compare_volumes(&flight, &packed, findings);
    found.is_reproduced = findings.is_empty();
    if findings.is_empty() {
        let facts =
            Facts::reported_by(packed.packed_with.clone(), flight, wishes.unpacked(folder)?)?;
        let sha256 = sha256_of_file(&log).map_err(at(&log))?;
        let made = made_files(&facts, &sha256, &packed.log)?;
        let given = [&packed.log, WISHES, PUBLIC_KEY, EARLIER].map(str::to_owned);
        let review = review_file(Path::new(&packed.log)).display().to_string();
        compare_files(folder, (listed, &made), (&given, &review), findings)?;
    }
    Ok(findings.is_empty().then_some(packed))
}

fn compare_volumes(flight: &Flight, packed: &PackedVolumes, findings: &mut Vec<Finding>) {
    let computed: Vec<PackedVolume> = flight.accounts.iter().map(PackedVolume::from).collect();
    if computed.len() != packed.volumes.len() {
        findings.push(Finding::OtherVolumes("some bays".to_owned()));
    }
    for (computed, packed) in std::iter::zip(&computed, &packed.volumes) {
        let is_same = computed.bits == packed.bits
            && computed.name == packed.name
            && computed.volume_m3.to_bits() == packed.volume_m3.to_bits()
            && computed.sigma_m3.to_bits() == packed.sigma_m3.to_bits();
        if !is_same {
            findings.push(Finding::OtherVolumes(packed.name.clone()));
        }
    }
}

/// Every file that can be made is there and equal, and beside those only what they are made of.
fn compare_files(
    folder: &Path,
    (listed, made): (&BTreeSet<String>, &[(String, Vec<u8>)]),
    (given, review): (&[String], &str),
    findings: &mut Vec<Finding>,
) -> Result<(), AuditError> {
    for (name, bytes) in made {
        if !listed.contains(name) {
            findings.push(Finding::Lacking(name.clone()));
        } else if read(folder, name)? != *bytes {
            findings.push(Finding::NotMadeOfLog(name.clone()));
        }
    }
    let is_of_pack = |name: &&String| {
        made.iter().any(|(made, _)| made == *name)
            || given.contains(name)
            || name.as_str() == review
    };
    let foreign = listed.iter().filter(|name| !is_of_pack(name)).cloned();
    findings.extend(foreign.map(Finding::Foreign));
    Ok(())
}
