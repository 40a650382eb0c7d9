//! systemd's watchdog is fed by the brain's own ticks, as systemd sees it.

use crate::service::pilot;
use std::io::{BufRead as _, BufReader, Write as _};
use std::os::unix::net::UnixDatagram;
use std::process::{Child, Command, Stdio};
use std::sync::{Arc, Mutex};
use std::time::Duration;
use stockpilot::link;
use stockpilot::messages::Declaration;
use stockpilot::pilot::{Action, Event};
use stockpilot::service::clock::Clock;
use stockpilot::service::{Recorder, Service, ServiceSetup, watchdog};
use stockpilot::time::{Mono, Stamp};
use tokio::sync::mpsc;
use tokio_util::sync::CancellationToken;

/// Says that this process is the service, which this test is in another process.
const IS_SERVICE: &str = "STOCKPILOT_TEST_IS_THE_SERVICE";
/// What a unit's `WatchdogSec` comes to, µs; the service looks four times in it.
const WATCHDOG_USEC: u32 = 200_000;
/// A service that is not heard for so long is not heard any more: five times the watchdog.
const SILENCE: Duration = Duration::from_secs(1);
/// One look may be due for ticks from before the hang, and some words may wait in the socket.
const MOST_LATE: usize = 20;
/// Bounds a test that would otherwise wait for ever.
const PATIENCE: Duration = Duration::from_secs(60);

#[test]
fn the_watchdog_is_fed_while_the_brain_ticks_and_starves_while_it_is_stuck() {
    if std::env::var_os(IS_SERVICE).is_some() {
        serve();
    }
    let folder = tempfile::tempdir().unwrap();
    let systemd = UnixDatagram::bind(folder.path().join("notify")).unwrap();
    systemd.set_read_timeout(Some(PATIENCE)).unwrap();
    let mut service = begin(&folder.path().join("notify"));
    assert_eq!(heard(&systemd).as_deref(), Some("READY=1"));
    for _ in 0..10 {
        assert_eq!(heard(&systemd).as_deref(), Some("WATCHDOG=1"));
    }
    let mut told = BufReader::new(service.stdout.take().unwrap()).lines();
    let mut ask = |word: &str| {
        writeln!(service.stdin.as_ref().unwrap(), "{word}").unwrap();
        told.find(|line| line.as_ref().unwrap() == "stuck").unwrap().unwrap();
    };
    // The brain hangs in the middle of an event; everything else in the process goes on.
    ask("hang");
    systemd.set_read_timeout(Some(SILENCE)).unwrap();
    let n_late = std::iter::from_fn(|| heard(&systemd)).take(MOST_LATE).count();
    println!("{n_late} words between the hang and the silence");
    assert!(n_late < MOST_LATE);
    assert_eq!(heard(&systemd), None);
    // It is the brain that was not heard, not the process.
    systemd.set_read_timeout(Some(PATIENCE)).unwrap();
    writeln!(service.stdin.as_ref().unwrap(), "go on").unwrap();
    assert_eq!(heard(&systemd).as_deref(), Some("WATCHDOG=1"));
    drop(service.stdin.take());
    assert!(service.wait().unwrap().success());
    assert_eq!(
        std::iter::from_fn(|| heard(&systemd)).find(|word| word == "STOPPING=1").map(drop),
        Some(())
    );
}

fn begin(notify_socket: &std::path::Path) -> Child {
    let name = "watchdog::the_watchdog_is_fed_while_the_brain_ticks_and_starves_while_it_is_stuck";
    Command::new(std::env::current_exe().unwrap())
        .args(["--exact", name, "--nocapture"])
        .env(IS_SERVICE, "1")
        .env("NOTIFY_SOCKET", notify_socket)
        .env("WATCHDOG_USEC", WATCHDOG_USEC.to_string())
        .env_remove("WATCHDOG_PID")
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .unwrap()
}

/// The next word to systemd; `None` after the time-out.
fn heard(systemd: &UnixDatagram) -> Option<String> {
    let mut datagram = [0; 256];
    let length = systemd.recv(&mut datagram).ok()?;
    Some(String::from_utf8_lossy(&datagram[..length]).trim().to_owned())
}

/// Keeps nothing, and waits for the gate with each event: the brain's task waits with it.
struct Gated(Arc<Mutex<()>>);

impl Recorder for Gated {
    fn event(&mut self, _at: Stamp<Mono>, _event: &Event) {
        drop(self.0.lock().unwrap());
    }
    fn action(&mut self, _at: Stamp<Mono>, _action: &Action) {}
    fn declared(&mut self, _at: Stamp<Mono>, _said: &Declaration) {}
    fn lost(&self) -> u64 {
        0
    }
    fn close(self: Box<Self>) -> u64 {
        0
    }
}

/// Runs the service on the real clock until the input ends; `hang` closes the gate, `go on` opens it.
fn serve() -> ! {
    let gate = Arc::new(Mutex::new(()));
    let runtime = tokio::runtime::Runtime::new().unwrap();
    let stop = CancellationToken::new();
    let setup = ServiceSetup {
        pilot: pilot(),
        link: link::Settings::new("udpin:127.0.0.1:0".parse().unwrap()),
        clock: Clock::real(),
        stop: stop.clone(),
        scans: mpsc::channel(1).1,
        tags: mpsc::channel(1).1,
        storage: mpsc::channel(1).1,
        recorder: Some(Box::new(Gated(Arc::clone(&gate)))),
        page: None,
    };
    let service = runtime.block_on(Service::start(setup)).unwrap();
    std::thread::spawn(move || obey(&gate, &stop));
    runtime.block_on(async {
        tokio::select! {
            () = watchdog::feed(|| service.last_tick()) => {}
            () = ended(&service) => {}
        }
        watchdog::stopping();
    });
    runtime.block_on(service.join()).unwrap();
    std::process::exit(0)
}

async fn ended(service: &stockpilot::service::RunningService) {
    let mut status = service.status();
    while status.changed().await.is_ok() {}
}

fn obey(gate: &Mutex<()>, stop: &CancellationToken) {
    let mut lines = std::io::stdin().lines();
    while let Some(Ok(word)) = lines.next() {
        if word == "hang" {
            let _closed = gate.lock().unwrap();
            let mut out = std::io::stdout();
            writeln!(out, "\nstuck").and_then(|()| out.flush()).unwrap();
            assert_eq!(lines.next().unwrap().unwrap(), "go on");
        }
    }
    stop.cancel();
}
