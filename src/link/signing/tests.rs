//! Signing against frames of pymavlink, and against the `mavlink` crate's own checker.

use super::*;
use mavlink::dialects::ardupilotmega::MavMessage;
use mavlink::{MavlinkReader, SigningConfig, SigningData};
use std::os::unix::fs::PermissionsExt as _;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use tempfile::TempDir;

/// Bytes 0 to 31.
const KEY: &str = "000102030405060708090a0b0c0d0e0f101112131415161718191a1b1c1d1e1f";
/// 2026-01-01T00:00:00Z in Unix time, s.
const NEW_YEAR_S: u64 = 1_767_225_600;
/// The same since 2015-01-01 in units of 10 µs: 4018 days.
const NEW_YEAR: u64 = 4_018 * 86_400 * 100_000;

/// A folder with a key, and a clock that is moved by hand.
struct Scene {
    folder: TempDir,
    unix_us: Arc<AtomicU64>,
}

impl Scene {
    fn new() -> Self {
        let scene = Self {
            folder: TempDir::new().unwrap(),
            unix_us: Arc::new(AtomicU64::new(NEW_YEAR_S * 1_000_000)),
        };
        write_key(&scene.folder.path().join("key"), KEY, 0o600);
        scene
    }

    fn settings(&self) -> SigningSettings {
        SigningSettings {
            key_file: self.folder.path().join("key"),
            stamp_file: self.folder.path().join("stamp"),
            link_id: 7,
            max_ahead: Duration::from_secs(60),
            accept_unsigned: BTreeSet::from([0, 109]),
        }
    }

    fn open(&self) -> Signing {
        let unix_us = Arc::clone(&self.unix_us);
        let wall = WallClock::new(move || Duration::from_micros(unix_us.load(Ordering::Relaxed)));
        Signing::open(&self.settings(), wall).unwrap()
    }

    fn set_clock(&self, unix_s: u64) {
        self.unix_us.store(unix_s * 1_000_000, Ordering::Relaxed);
    }
}

fn write_key(path: &Path, text: &str, mode: u32) {
    std::fs::write(path, text).unwrap();
    std::fs::set_permissions(path, std::fs::Permissions::from_mode(mode)).unwrap();
}

fn frame(bytes: &[u8]) -> MAVLinkMessageRaw {
    MavlinkReader::new(bytes).read_any_raw_message::<MavMessage>().unwrap()
}

/// A frame signed at this stamp by the `mavlink` crate's hash with `key`.
fn signed(
    message: &MavMessage,
    sender: (u32, u8),
    stamp: u64,
    key: &[u8; 32],
) -> MAVLinkMessageRaw {
    let header = mavlink::MavHeader { system_id: sender.0, component_id: sender.1, sequence: 0 };
    let mut raw = MAVLinkV2MessageRaw::new();
    raw.serialize_message_for_signing(header, message);
    raw.signature_timestamp_bytes_mut().copy_from_slice(&stamp.to_le_bytes()[..6]);
    let mut signature = [0; 6];
    raw.calculate_signature(key, &mut signature);
    raw.signature_value_mut().copy_from_slice(&signature);
    MAVLinkMessageRaw::V2(raw)
}

fn unsigned(message: &MavMessage, sender: (u32, u8)) -> MAVLinkMessageRaw {
    let header = mavlink::MavHeader { system_id: sender.0, component_id: sender.1, sequence: 0 };
    let mut raw = MAVLinkV2MessageRaw::new();
    raw.serialize_message(header, message);
    MAVLinkMessageRaw::V2(raw)
}

fn heartbeat() -> MavMessage {
    MavMessage::HEARTBEAT(HEARTBEAT_DATA::default())
}

fn command() -> MavMessage {
    MavMessage::COMMAND_LONG(mavlink::dialects::ardupilotmega::COMMAND_LONG_DATA::default())
}

fn key_bytes() -> [u8; 32] {
    std::array::from_fn(|k| u8::try_from(k).unwrap())
}

#[test]
fn frames_that_pymavlink_signed_are_good_once() {
    let mut signing = Scene::new().open();
    let (text, command) = (frame(&PYMAVLINK_STATUSTEXT), frame(&PYMAVLINK_COMMAND));
    assert_eq!(signing.judge(&text), Ok(Proof::Signed));
    assert_eq!(signing.judge(&command), Ok(Proof::Signed), "another stream");
    assert_eq!(signing.judge(&text), Err(Refusal::Replayed));
    let mut changed = PYMAVLINK_COMMAND;
    // The link's number is under the signature and not under the checksum.
    let link = changed.len() - 13;
    changed[link] ^= 1;
    assert_eq!(signing.judge(&frame(&changed)), Err(Refusal::WrongSignature));
}

#[test]
fn its_own_frames_are_what_pymavlink_would_send() {
    let scene = Scene::new();
    let MAVLinkMessageRaw::V2(theirs) = frame(&PYMAVLINK_COMMAND) else { panic!("version 2") };
    let mut ours = theirs;
    scene.unix_us.store(NEW_YEAR_S * 1_000_000 + 20, Ordering::Relaxed);
    let mut signing = scene.open();
    signing.link_id = theirs.signature_link_id();
    ours.signature_value_mut().fill(0);
    signing.sign(&mut ours);
    assert_eq!(ours.signature_timestamp(), NEW_YEAR + 2);
    assert_eq!(ours.raw_bytes(), theirs.raw_bytes());
}

#[test]
fn the_mavlink_crate_accepts_its_frames_once() {
    // The other checker asks the computer's clock itself.
    let wall = WallClock::new(|| {
        Duration::from_nanos(jiff::Timestamp::now().as_nanosecond().try_into().unwrap())
    });
    let scene = Scene::new();
    let mut signing = Signing::open(&scene.settings(), wall).unwrap();
    let theirs = SigningData::from_config(SigningConfig::new(key_bytes(), 0, false, false));
    for _ in 0..100 {
        let MAVLinkMessageRaw::V2(mut raw) = signed(&command(), (1, 191), 0, &[0; 32]) else {
            panic!("version 2")
        };
        assert!(!theirs.verify_signature(&raw));
        signing.sign(&mut raw);
        assert!(theirs.verify_signature(&raw));
        assert!(!theirs.verify_signature(&raw), "a replay");
    }
}

#[test]
fn wrong_key_old_and_future_stamps_are_refused() {
    let mut signing = Scene::new().open();
    let minute = 60 * UNITS_PER_SECOND;
    let mut judge =
        |stamp, key: [u8; 32], sender| signing.judge(&signed(&command(), sender, stamp, &key));
    assert_eq!(judge(NEW_YEAR, [9; 32], (1, 1)), Err(Refusal::WrongSignature));
    // At the border of the minute and beyond it, both ways.
    assert_eq!(judge(NEW_YEAR - minute - 1, key_bytes(), (1, 1)), Err(Refusal::Old));
    assert_eq!(judge(NEW_YEAR + minute + 1, key_bytes(), (1, 1)), Err(Refusal::FromFuture));
    assert_eq!(judge(u64::MAX >> 16, key_bytes(), (1, 1)), Err(Refusal::FromFuture));
    assert_eq!(judge(NEW_YEAR - minute, key_bytes(), (1, 1)), Ok(Proof::Signed));
    // A stream that runs may lag behind; it must only go forward.
    assert_eq!(judge(NEW_YEAR - minute + 1, key_bytes(), (1, 1)), Ok(Proof::Signed));
    assert_eq!(judge(NEW_YEAR - minute + 1, key_bytes(), (1, 1)), Err(Refusal::Replayed));
    assert_eq!(judge(NEW_YEAR - minute, key_bytes(), (1, 1)), Err(Refusal::Replayed));
    assert_eq!(judge(NEW_YEAR + minute, key_bytes(), (1, 1)), Ok(Proof::Signed));
    // A believed stamp ahead does not move the bound on the future, so nobody can walk it away.
    assert_eq!(judge(NEW_YEAR + minute + 1, key_bytes(), (1, 1)), Err(Refusal::FromFuture));
}

#[test]
fn what_an_earlier_run_has_heard_cannot_begin_a_stream() {
    let scene = Scene::new();
    let start = signed(&command(), (255, 190), NEW_YEAR + 7, &key_bytes());
    let beat = |stamp| signed(&heartbeat(), (1, 1), stamp, &key_bytes());
    assert_eq!(scene.open().judge(&start), Ok(Proof::Signed));
    // The service restarts, and somebody who has listened is first to speak.
    let mut signing = scene.open();
    assert_eq!(signing.judge(&start), Err(Refusal::Old));
    // A heartbeat may make the acquaintance, of an autopilot without a clock too, and once it has signed
    // with ours, none of an earlier time counts.
    assert_eq!(signing.judge(&beat(NEW_YEAR + 8)), Ok(Proof::SignedBefore));
    assert_eq!(signing.judge(&beat(5)), Ok(Proof::SignedBefore));
    // The ground station has heard this side, which sets its clock, and goes on.
    let MAVLinkMessageRaw::V2(mut own) = unsigned(&heartbeat(), (1, 191)) else {
        panic!("version 2")
    };
    signing.sign(&mut own);
    let next = own.signature_timestamp() + 1;
    let resumed = signed(&command(), (255, 190), next, &key_bytes());
    assert_eq!(signing.judge(&resumed), Ok(Proof::Signed));
    assert_eq!(signing.judge(&start), Err(Refusal::Replayed));
    assert_eq!(signing.judge(&beat(next)), Ok(Proof::Signed));
    assert_eq!(signing.judge(&beat(NEW_YEAR + 9)), Err(Refusal::Replayed));
}

#[test]
fn unsigned_heartbeats_count_until_their_sender_has_signed() {
    let mut signing = Scene::new().open();
    assert_eq!(signing.judge(&unsigned(&heartbeat(), (1, 1))), Ok(Proof::NotNeeded));
    assert_eq!(signing.judge(&unsigned(&command(), (1, 1))), Err(Refusal::Unsigned));
    // Even with a wrong signature it is as good as an unsigned one.
    assert_eq!(
        signing.judge(&signed(&heartbeat(), (1, 1), NEW_YEAR, &[9; 32])),
        Ok(Proof::NotNeeded)
    );
    assert_eq!(
        signing.judge(&signed(&command(), (1, 1), NEW_YEAR, &key_bytes())),
        Ok(Proof::Signed)
    );
    assert_eq!(signing.judge(&unsigned(&heartbeat(), (1, 1))), Err(Refusal::Unsigned));
    let forged = signed(&heartbeat(), (1, 1), NEW_YEAR + 5, &[9; 32]);
    assert_eq!(signing.judge(&forged), Err(Refusal::WrongSignature));
    assert_eq!(
        signing.judge(&unsigned(&heartbeat(), (1, 51))),
        Ok(Proof::NotNeeded),
        "another component"
    );
}

#[test]
fn stamps_grow_over_restarts_and_backward_clocks() {
    let scene = Scene::new();
    let mut last = 0;
    let mut sign = |signing: &mut Signing| {
        let MAVLinkMessageRaw::V2(mut raw) = signed(&command(), (1, 191), 0, &[0; 32]) else {
            panic!("version 2")
        };
        signing.sign(&mut raw);
        assert!(raw.signature_timestamp() > last, "{} after {last}", raw.signature_timestamp());
        last = raw.signature_timestamp();
        last
    };
    // Six starts: forward, back by an hour, at 1970, at 1970 again, forward by a day, back.
    let hour = 3_600;
    for unix_s in
        [NEW_YEAR_S, NEW_YEAR_S - hour, 0, 0, NEW_YEAR_S + 24 * hour, NEW_YEAR_S + 3 * hour]
    {
        scene.set_clock(unix_s);
        let mut signing = scene.open();
        for _ in 0..3 {
            sign(&mut signing);
        }
    }
}

#[test]
fn a_long_run_keeps_its_file_ahead_of_itself() {
    let scene = Scene::new();
    let mut signing = scene.open();
    let held = || -> u64 {
        std::fs::read_to_string(scene.folder.path().join("stamp")).unwrap().trim().parse().unwrap()
    };
    let mut last = 0;
    for second in 0..120 {
        scene.set_clock(NEW_YEAR_S + second);
        last = signing.stamps.next();
        // The file is written by another thread: it has the time that the disk needs.
        while held() <= last {
            std::thread::yield_now();
        }
    }
    assert!(held() <= last + stamps::RESERVED, "{} for {last}", held());
    // Killed here: the next run begins behind everything that was used.
    scene.set_clock(0);
    drop(signing);
    assert!(scene.open().stamps.next() > last);
}

#[test]
fn keys_that_others_can_read_or_that_are_none_are_refused_without_telling_them() {
    let scene = Scene::new();
    let path = scene.folder.path().join("key");
    for (text, mode, word) in [
        (KEY, 0o640, "chmod 600"),
        (&KEY[1..], 0o600, "64 hexadecimal digits"),
        (&KEY.replace('0', "g"), 0o600, "64 hexadecimal digits"),
        (&format!("{KEY}00"), 0o600, "64 hexadecimal digits"),
    ] {
        write_key(&path, text, mode);
        let error = Key::read(&path).unwrap_err();
        assert!(error.to_string().contains(word), "{error}");
        assert!(!format!("{error:?}{error}").contains(&text[4..20]), "{error:?}");
    }
    std::fs::remove_file(&path).unwrap();
    assert!(matches!(Key::read(&path), Err(KeyError::Unreadable { .. })));
    write_key(&path, &format!("{KEY}\n"), 0o600);
    let key = Key::read(&path).unwrap();
    assert_eq!(key, Key::new(key_bytes()));
    assert_eq!(format!("{key:?}"), "Key(secret)");
    assert!(!format!("{:?}", scene.open()).contains("31, "), "no byte of the key in a trace");
}

#[test]
fn a_damaged_stamp_file_is_not_taken_for_none() {
    let scene = Scene::new();
    let path = scene.folder.path().join("stamp");
    for text in ["", "soon", "-4", "281474976710656"] {
        std::fs::write(&path, text).unwrap();
        let wall = WallClock::new(|| Duration::from_secs(NEW_YEAR_S));
        let result = Signing::open(&scene.settings(), wall);
        assert!(
            matches!(result, Err(SigningError::Ledger(LedgerError::Malformed { .. }))),
            "{text:?}"
        );
    }
}
/// Of pymavlink 2.4.50, `MAVLink.signing` with [`KEY`].
const PYMAVLINK_STATUSTEXT: [u8; 45] = [
    0xfd, 0x14, 0x01, 0x00, 0x00, 0xff, 0xbe, 0xfd, 0x00, 0x00, 0x06, 0x73, 0x69, 0x67, 0x6e, 0x65,
    0x64, 0x20, 0x62, 0x79, 0x20, 0x70, 0x79, 0x6d, 0x61, 0x76, 0x6c, 0x69, 0x6e, 0x6b, 0xab, 0xac,
    0x03, 0x01, 0xe0, 0x3c, 0xd6, 0x92, 0x1f, 0xa0, 0x08, 0x61, 0x98, 0xd9, 0xe1,
];
/// Of pymavlink 2.4.50, `MAVLink.signing` with [`KEY`].
const PYMAVLINK_COMMAND: [u8; 57] = [
    0xfd, 0x20, 0x01, 0x00, 0x00, 0xff, 0xbe, 0x4c, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00,
    0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00,
    0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x22, 0x79, 0x01, 0xbf, 0xb1, 0xdf, 0x04, 0x02, 0xe0, 0x3c,
    0xd6, 0x92, 0x1f, 0x65, 0xbb, 0xe2, 0xea, 0x6d, 0xa8,
];
