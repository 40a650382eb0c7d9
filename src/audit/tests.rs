use super::*;
use crate::record::COMMIT_NOT_STAMPED;
use std::os::unix::fs::PermissionsExt as _;

#[test]
fn a_key_is_for_its_owner_only_and_never_overwritten() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("audit.key");
    let public_path = make_key(&path).expect("a key");
    let mode = std::fs::metadata(&path).expect("a file").permissions().mode() & 0o777;
    assert_eq!(mode, 0o600);
    let key = AuditKey::read(&path).expect("a key");
    let public = read_public_key(&public_path).expect("a key");
    assert_eq!(public.to_base64(), key.public.to_base64());
    assert!(!format!("{key:?}").contains("secret"), "the secret half is shown");
    let before = std::fs::read(&path).expect("a file");
    assert!(matches!(make_key(&path), Err(AuditError::File { .. })));
    assert_eq!(std::fs::read(&path).expect("a file"), before);
    std::fs::set_permissions(&path, std::fs::Permissions::from_mode(0o640)).expect("a mode");
    assert!(matches!(AuditKey::read(&path), Err(AuditError::SharedKey { mode: 0o640, .. })));
}

#[test]
fn a_name_with_a_path_does_not_reach_out_of_the_pack() {
    let folder = tempfile::tempdir().expect("a folder");
    make_key(&folder.path().join("a.key")).expect("a key");
    let key = AuditKey::read(&folder.path().join("a.key")).expect("a key");
    let pack = folder.path().join("pack");
    std::fs::create_dir(&pack).expect("a folder");
    let sums = format!("{}  ../a.key\n", "0".repeat(64));
    let signature = minisign::sign(Some(&key.public), &key.secret, sums.as_bytes(), None, None)
        .expect("a signature");
    std::fs::write(pack.join(SUMS), &sums).expect("a file");
    std::fs::write(pack.join(SIGNATURE), signature.into_string()).expect("a file");
    let found = verify(&pack, Some(&key.public)).expect("a verification");
    assert_eq!(found.findings, [Finding::BadList(sums.trim_end().to_owned())]);
    assert!(found.volumes.is_none());
}

#[test]
fn another_key_is_told() {
    let folder = tempfile::tempdir().expect("a folder");
    for name in ["a.key", "b.key"] {
        make_key(&folder.path().join(name)).expect("a key");
    }
    let read = |name: &str| AuditKey::read(&folder.path().join(name)).expect("a key");
    let (a, b) = (read("a.key"), read("b.key"));
    let pack = folder.path().join("pack");
    std::fs::create_dir(&pack).expect("a folder");
    std::fs::write(pack.join(SUMS), "").expect("a file");
    let signature =
        minisign::sign(Some(&a.public), &a.secret, &b""[..], None, None).expect("a signature");
    std::fs::write(pack.join(SIGNATURE), signature.into_string()).expect("a file");
    let findings = verify(&pack, Some(&b.public)).expect("a verification").findings;
    assert!(matches!(findings[..], [Finding::BadSignature(_)]), "{findings:?}");
}

#[test]
fn a_log_outside_of_the_pack_is_not_read() {
    let folder = tempfile::tempdir().expect("a folder");
    make_key(&folder.path().join("a.key")).expect("a key");
    let key = AuditKey::read(&folder.path().join("a.key")).expect("a key");
    let pack = folder.path().join("pack");
    std::fs::create_dir(&pack).expect("a folder");
    // There is such a file, and the signer has signed all that lies in the pack.
    std::fs::write(folder.path().join("x.mcap"), "no log").expect("a file");
    let volumes = "{\"log\":\"../x.mcap\",\"version\":\"\",\"flown_with\":\"\",\
                   \"packed_with\":\"\",\"volumes\":[]}";
    let wishes = "{\"flight\":1,\"target_percent\":2.0,\"target_least_m3\":0.5,\"risk\":0.05,\
                  \"independent\":[],\"books\":[]}";
    let mut sums = String::new();
    for (name, text) in [(VOLUMES, volumes), (WISHES, wishes), (CONFIG, ""), (PUBLIC_KEY, "")] {
        std::fs::write(pack.join(name), text).expect("a file");
        let sum = crate::export::sha256_of_bytes(text.as_bytes());
        sums.push_str(&format!("{sum}  {name}\n"));
    }
    std::fs::write(pack.join(SUMS), &sums).expect("a file");
    let signature = key.sign(sums.as_bytes(), "").expect("a signature");
    std::fs::write(pack.join(SIGNATURE), signature).expect("a file");
    let found = verify(&pack, Some(&key.public)).expect("a verification");
    assert_eq!(found.findings, [Finding::Missing("../x.mcap".to_owned())]);
    assert!(found.volumes.is_none());
}

#[test]
fn another_build_excuses_what_depends_on_builds_and_nothing_else() {
    let found = |packed_with: Option<&str>, is_reproduced, findings: &[&Finding]| Verification {
        findings: findings.iter().map(|finding| (*finding).clone()).collect(),
        n_files: 1,
        volumes: None,
        is_reproduced,
        packed_with: packed_with.map(str::to_owned),
        verified_with: "1.0 (b)".to_owned(),
        key_is_from_pack: false,
    };
    let report = Finding::NotMadeOfLog("report.pdf".to_owned());
    let numbers = Finding::NotReproduced("1.0 (a)".to_owned());
    let unread = Finding::Unreadable("unknown field".to_owned());
    let forged = Finding::OtherVolumes("hall".to_owned());
    let changed = Finding::Changed("a.mcap".to_owned());
    let added = Finding::Added("b".to_owned());
    let (same, other) = (Some("1.0 (b)"), Some("1.0 (a)"));
    for (verification, judgement) in [
        (found(same, true, &[]), Judgement::Equal),
        (found(other, true, &[]), Judgement::Equal),
        (found(same, true, &[&report]), Judgement::Differs),
        (found(other, true, &[&report]), Judgement::ReportNotJudged),
        (found(same, false, &[&numbers]), Judgement::Differs),
        (found(other, false, &[&numbers]), Judgement::VolumesNotJudged),
        (found(None, false, &[&unread]), Judgement::VolumesNotJudged),
        (found(other, false, &[&forged, &numbers]), Judgement::Differs),
        (found(other, false, &[&changed]), Judgement::Differs),
        (found(other, true, &[&report, &added]), Judgement::Differs),
    ] {
        assert_eq!(verification.judgement(), judgement, "{verification:?}");
    }
    assert!(!found(same, true, &[&changed]).may_be_a_namesake());
    let unstamped = format!("1.0 ({COMMIT_NOT_STAMPED})");
    let differing = |finding: &Finding| Verification {
        verified_with: unstamped.clone(),
        ..found(Some(&unstamped), false, &[finding])
    };
    let numbers = Finding::NotReproduced(unstamped.clone());
    assert!(differing(&numbers).may_be_a_namesake());
    assert!(!differing(&changed).may_be_a_namesake());
}
