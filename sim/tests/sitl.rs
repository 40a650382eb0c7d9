//! The real service flies on an autopilot in another process, with a vehicle of its own: the stub as
//! a program stands in for the simulators of PX4 and `ArduPilot`. In real time, about a minute.

#![expect(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::print_stdout,
    reason = "tests may panic, and tell what they flew"
)]

use std::io::{BufRead, BufReader, Lines};
use std::path::Path;
use std::process::{Child, ChildStdout, Command, Stdio};
use std::sync::{Mutex, PoisonError};

/// Real-time flights must not starve each other.
static ONE_AT_A_TIME: Mutex<()> = Mutex::new(());

/// A program that ends with the test.
struct Program {
    child: Child,
    lines: Lines<BufReader<ChildStdout>>,
}

impl Program {
    fn start(words: &[&str]) -> Self {
        let mut child = Command::new(env!("CARGO_BIN_EXE_stockpilot-sim"))
            .args(words)
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let lines = BufReader::new(child.stdout.take().unwrap()).lines();
        Self { child, lines }
    }

    fn next_json(&mut self) -> serde_json::Value {
        serde_json::from_str(&self.lines.next().expect("a line").unwrap()).unwrap()
    }
}

impl Drop for Program {
    fn drop(&mut self) {
        // It may have ended by itself.
        let _ended = self.child.kill().and_then(|()| self.child.wait());
    }
}

/// The flight that is flown: a short way over the piles, kept as the paper keeps it.
fn flight(directory: &Path) -> Vec<String> {
    let fixed = "fly --world piles --seed 3 --surface kalman-grid --steps 6 --json --log";
    let mut words: Vec<String> = fixed.split(' ').map(str::to_owned).collect();
    words.push(directory.to_str().unwrap().to_owned());
    words
}

fn text<'a>(opened: &'a serde_json::Value, key: &str) -> &'a str {
    opened[key].as_str().unwrap_or_else(|| panic!("no {key} in {opened}"))
}

fn judge(run: &serde_json::Value, autopilot: &str) {
    println!("{run}");
    assert_eq!(run["autopilot"], autopilot);
    assert_eq!(run["complete"], true);
    assert_eq!(run["collided"], false);
    assert!(run["steps"].as_u64().unwrap() >= 6);
    // 6 m to the first waypoint, legs, and back; a mirrored or turned track would not come home.
    assert!(run["path_length_m"].as_f64().unwrap() > 15.0);
    // In real time a starved machine leaves holes in the stream of inertial samples, so a hand's breadth
    // is allowed; a mirrored or turned track would be metres off.
    assert!(run["position_rms_m"].as_f64().unwrap() < 0.1);
    assert!(run["position_within_3_sigma"].as_f64().unwrap() > 0.5);
    assert!(run["relative_error"].as_f64().unwrap().abs() < 0.15);
}

/// PX4's simulation calls the companion, the simulator's listener and the ground station.
#[test]
fn the_service_flies_on_a_px4_of_another_process() {
    let _alone = ONE_AT_A_TIME.lock().unwrap_or_else(PoisonError::into_inner);
    let directory = tempfile::tempdir().unwrap();
    let mut words = flight(directory.path());
    words.extend(
        ["--autopilot-link", "--truth", "--ground-link"]
            .map(str::to_owned)
            .into_iter()
            .flat_map(|option| [option, "udpin:127.0.0.1:0".to_owned()]),
    );
    let words: Vec<&str> = words.iter().map(String::as_str).collect();
    let mut fly = Program::start(&words);
    let opened = fly.next_json();
    let out = |key| format!("udpout:{}", text(&opened, key));
    let (link, truth, ground) = (out("autopilot_link"), out("truth"), out("ground"));
    let mut stub = Program::start(&[
        "autopilot",
        "--flavour",
        "px4",
        "--home=47.397742,8.545594,489.4,40",
        "--listen",
        &link,
        "--truth",
        &truth,
        "--ground",
        &ground,
    ]);
    stub.next_json();
    judge(&fly.next_json(), "px4");
}

/// `ArduPilot`'s simulation serves TCP; the truth is asked for on the service's own link.
#[test]
fn the_service_flies_on_an_ardupilot_of_another_process_with_the_truth_on_its_link() {
    let _alone = ONE_AT_A_TIME.lock().unwrap_or_else(PoisonError::into_inner);
    let directory = tempfile::tempdir().unwrap();
    let mut stub = Program::start(&[
        "autopilot",
        "--flavour",
        "ardupilot",
        "--home=-35.363261,149.165230,584,353",
        "--listen",
        "tcpin:127.0.0.1:0",
        "--ground",
        "tcpin:127.0.0.1:0",
    ]);
    let opened = stub.next_json();
    let out = |key| format!("tcpout:{}", text(&opened, key));
    let (link, ground) = (out("listen"), out("ground"));
    let mut words = flight(directory.path());
    words.extend(
        ["--truth", "link", "--autopilot-link", &link, "--ground-link", &ground].map(str::to_owned),
    );
    let words: Vec<&str> = words.iter().map(String::as_str).collect();
    let mut fly = Program::start(&words);
    fly.next_json();
    judge(&fly.next_json(), "ardupilot");
}

/// Both sign, and nothing unsigned passes; the truth comes on the simulator's link.
#[test]
fn the_service_flies_on_a_signed_link() {
    let _alone = ONE_AT_A_TIME.lock().unwrap_or_else(PoisonError::into_inner);
    let directory = tempfile::tempdir().unwrap();
    let key = directory.path().join("link.key");
    write_private(&key, &"5a".repeat(32));
    let key = key.to_str().unwrap().to_owned();
    let mut stub = Program::start(&[
        "autopilot",
        "--flavour",
        "px4",
        "--listen",
        "tcpin:127.0.0.1:0",
        "--ground",
        "tcpin:127.0.0.1:0",
        "--truth",
        "tcpin:127.0.0.1:0",
        "--signing-key",
        &key,
    ]);
    let opened = stub.next_json();
    let out = |key| format!("tcpout:{}", text(&opened, key));
    let (link, ground, truth) = (out("listen"), out("ground"), out("truth"));
    let mut words = flight(directory.path());
    words.extend(
        [
            "--autopilot-link",
            &link,
            "--ground-link",
            &ground,
            "--truth",
            &truth,
            "--signing-key",
            &key,
        ]
        .map(str::to_owned),
    );
    let words: Vec<&str> = words.iter().map(String::as_str).collect();
    let mut fly = Program::start(&words);
    fly.next_json();
    judge(&fly.next_json(), "px4");
}

fn write_private(path: &Path, text: &str) {
    use std::io::Write as _;
    use std::os::unix::fs::OpenOptionsExt as _;
    let mut options = std::fs::OpenOptions::new();
    let mut file = options.write(true).create_new(true).mode(0o600).open(path).unwrap();
    file.write_all(text.as_bytes()).unwrap();
}
