//! A program that is killed while it writes settings leaves the old file or the new one.

use rand::{RngExt as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;
use std::io::{BufRead as _, BufReader, Write as _};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::{Receiver, channel};
use std::time::Duration;
use stockpilot::config::{self, write_clock};

/// Where the child, which is this test in another process, writes for ever.
const FILE_OF_THE_CHILD: &str = "STOCKPILOT_TEST_WRITES_SETTINGS";
const N_KILLS: usize = 60;
/// The file with the example's settings takes about so long to write, fsync included.
const LONGEST_MOMENT: Duration = Duration::from_millis(12);

#[test]
fn settings_survive_sigkill_at_any_moment() {
    if let Some(path) = std::env::var_os(FILE_OF_THE_CHILD) {
        write_for_ever(Path::new(&path));
    }
    let seed = std::process::id();
    println!("seed {seed}");
    let mut random = ChaCha8Rng::seed_from_u64(seed.into());
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("hall.toml");
    let example = Path::new(env!("CARGO_MANIFEST_DIR")).join("deploy/config.example.toml");
    std::fs::copy(example, &path).unwrap();
    let untouched = std::fs::read_to_string(&path).unwrap();
    let mut kept = 0;
    let mut n_in_between = 0_u32;
    for _ in 0..N_KILLS {
        let (mut child, written) = begin(&path);
        // Some writes that end, then some part of one.
        let n_whole = random.random_range(1..4);
        let mut last = 0;
        for _ in 0..n_whole {
            last = written.recv().unwrap();
        }
        let moment = LONGEST_MOMENT.mul_f64(random.random());
        last = written.recv_timeout(moment).unwrap_or(last);
        child.kill().unwrap();
        child.wait().unwrap();
        last = written.iter().last().unwrap_or(last);
        kept = count_in(&path);
        let n_ahead = kept.checked_sub(last).unwrap();
        assert!(n_ahead <= 1, "{last} was written, {kept} is there");
        n_in_between += n_ahead;
    }
    // Nothing else in the file has suffered.
    write_clock(&path, 0.0, 0.002).unwrap();
    assert_eq!(std::fs::read_to_string(&path).unwrap(), untouched);
    println!("{kept} writes, {N_KILLS} kills, {n_in_between} between a write and its word");
}

fn begin(path: &Path) -> (Child, Receiver<u32>) {
    let mut child = Command::new(std::env::current_exe().unwrap())
        .args(["--exact", "sudden_end::settings_survive_sigkill_at_any_moment", "--nocapture"])
        .env(FILE_OF_THE_CHILD, path)
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    let (sender, written) = channel();
    let lines = BufReader::new(child.stdout.take().unwrap()).lines();
    std::thread::spawn(move || {
        let numbers = lines.map_while(Result::ok);
        let numbers = numbers.filter_map(|line| line.strip_prefix("written ")?.parse().ok());
        numbers.map_while(|n: u32| sender.send(n).ok()).for_each(drop);
    });
    (child, written)
}

/// Counts the LiDAR's clock offset up by a millisecond at a time and tells each that is written.
fn write_for_ever(path: &Path) -> ! {
    loop {
        let n = count_in(path) + 1;
        write_clock(path, 1e-3 * f64::from(n), 0.002).unwrap();
        let mut out = std::io::stdout();
        writeln!(out, "\nwritten {n}").and_then(|()| out.flush()).unwrap();
    }
}

/// How many writes the file has seen.
fn count_in(path: &Path) -> u32 {
    format!("{:.0}", config::load(path, &[]).unwrap().lidar.clock_offset_ms).parse().unwrap()
}
