//! The live page's server over real connections, with a mission that says what the test wants.

use std::io::{Read as _, Write as _};
use std::net::{SocketAddr, TcpStream};
use std::os::unix::fs::PermissionsExt as _;
use std::time::Duration;
use stockpilot::camera::CameraStats;
use stockpilot::config::Config;
use stockpilot::lidar::LidarStatus;
use stockpilot::messages::OperatorVerb;
use stockpilot::mission::Phase;
use stockpilot::pilot::{Outlook, Pilot};
use stockpilot::web::{
    self, BrainEnd, Floor, Pulse, RunningPage, Scene, Sensors, Settings, Surroundings,
};
use tokio::net::TcpSocket;
use tokio::sync::watch;
use tokio_util::sync::CancellationToken;

const TOKEN: &str = "0123456789abcdef";
const DECLARED: &str = "{\"by\":\" A.  Pilot\",\"nobody_inside\":true,\"remote_in_hand\":true,\
                        \"hall_as_before\":true,\"no_dust_zone\":true}";

struct Page {
    brain: BrainEnd,
    running: Option<RunningPage>,
    address: SocketAddr,
    stop: CancellationToken,
    /// Where the flight stands, for a brain that nobody steps.
    outlook: Outlook,
    _folder: tempfile::TempDir,
}

impl Drop for Page {
    fn drop(&mut self) {
        self.stop.cancel();
        if let Some(running) = self.running.take() {
            running.join();
        }
    }
}

impl Page {
    fn open() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let token_file = folder.path().join("token");
        std::fs::write(&token_file, TOKEN).unwrap();
        std::fs::set_permissions(&token_file, std::fs::Permissions::from_mode(0o600)).unwrap();
        let example = include_str!("../../deploy/config.example.toml");
        let config = Config::from_toml(example, "config.example.toml".as_ref()).unwrap();
        let pilot = config.pilot_settings().unwrap();
        let settings = Settings {
            listen: "127.0.0.1:0".parse().unwrap(),
            token_file: Some(token_file),
            host_names: Vec::new(),
            last_survey: None,
            target_percent: 2.0,
        };
        let stop = CancellationToken::new();
        let (scene, floor) = (Scene::new(&pilot), Floor::new(&pilot.mapping));
        let pilot = Pilot::new(pilot);
        let around = Surroundings {
            scene,
            floor,
            space: pilot.free_space(),
            sensors: Sensors {
                lidar: watch::channel(LidarStatus::default()).1,
                camera: watch::channel(CameraStats::default()).1,
            },
            log: folder.path().join("flight.mcap"),
            stop: stop.clone(),
        };
        let (brain, running) = web::start(&settings, around).unwrap();
        let address = running.address();
        let outlook = pilot.outlook();
        Self { brain, running: Some(running), address, stop, outlook, _folder: folder }
    }

    /// Sends one request and gives status and body.
    fn ask(&self, method: &str, path: &str, headers: &str, body: &str) -> (u16, String) {
        ask(self.address, &format!("{method} {path}"), headers, body)
    }

    fn wish(&self, verb: &str, headers: &str, body: &str) -> (u16, String) {
        self.ask("POST", &format!("/api/wishes/{verb}"), headers, body)
    }

    /// The same, with the token, while the mission answers.
    fn answered(&mut self, verb: &str, body: &str, says: (bool, Phase)) -> (u16, String) {
        let address = self.address;
        let wishes = &mut self.brain.wishes;
        std::thread::scope(|scope| {
            let mission = scope.spawn(move || {
                let wish = wishes.blocking_recv().unwrap();
                let verb = wish.verb;
                assert_eq!(wish.said.is_some(), verb.is_start());
                wish.answer(says.0, says.1);
                verb
            });
            let answer = ask(address, &format!("POST /api/wishes/{verb}"), &token(), body);
            assert_eq!(format!("{:?}", mission.join().unwrap()).to_lowercase(), verb);
            answer
        })
    }
}

fn ask(address: SocketAddr, what: &str, headers: &str, body: &str) -> (u16, String) {
    let mut link = TcpStream::connect(address).unwrap();
    let length = body.len();
    write!(
        link,
        "{what} HTTP/1.1\r\nHost: {address}\r\nConnection: close\r\n{headers}\
         Content-Type: application/json\r\nContent-Length: {length}\r\n\r\n{body}"
    )
    .unwrap();
    let mut answer = String::new();
    link.read_to_string(&mut answer).unwrap();
    let (head, body) = answer.split_once("\r\n\r\n").unwrap();
    (head.split(' ').nth(1).unwrap().parse().unwrap(), body.to_owned())
}

fn token() -> String {
    format!("X-Stockpilot-Token: {TOKEN}\r\n")
}

#[test]
fn motors_start_only_for_fresh_eyes_with_the_token() {
    let mut page = Page::open();
    assert_eq!(page.wish("start", "", "{}").0, 401);
    assert_eq!(page.wish("start", &token(), "{}").0, 409, "nobody looked");
    assert_eq!(page.wish("start", &token(), "{\"seq\":999999}").0, 409, "of another run");
    assert_eq!(page.wish("resume", &token(), "{}").0, 409);
    assert!(page.brain.wishes.try_recv().is_err(), "the mission heard nothing of it");
    let (status, state) = page.ask("GET", "/api/state", "", "");
    assert_eq!(status, 200);
    let state: serde_json::Value = serde_json::from_str(&state).unwrap();
    let said = format!("{{\"seq\":{},\"declared\":{DECLARED}}}", state["seq"]);
    let (status, answer) = page.answered("start", &said, (true, Phase::Preflight));
    assert_eq!(status, 200, "{answer}");
    let answer: serde_json::Value = serde_json::from_str(&answer).unwrap();
    assert_eq!((&answer["is_accepted"], &answer["phase"]), (&true.into(), &"preflight".into()));
}

#[test]
fn motors_start_only_for_somebody_with_a_name_who_says_all_four_things() {
    let mut page = Page::open();
    let (_, state) = page.ask("GET", "/api/state", "", "");
    let state: serde_json::Value = serde_json::from_str(&state).unwrap();
    let body = |declared: &serde_json::Value| {
        serde_json::json!({ "seq": state["seq"], "declared": declared }).to_string()
    };
    let whole: serde_json::Value = serde_json::from_str(DECLARED).unwrap();
    for verb in ["start", "fly-gaps"] {
        let seq_only = format!("{{\"seq\":{}}}", state["seq"]);
        assert_eq!(page.wish(verb, &token(), &seq_only).0, 422);
        for point in ["nobody_inside", "remote_in_hand", "hall_as_before", "no_dust_zone", "by"] {
            let mut lacking = whole.clone();
            lacking.as_object_mut().unwrap().remove(point);
            assert_eq!(page.wish(verb, &token(), &body(&lacking)).0, 422, "without {point}");
            lacking[point] = if point == "by" { " ".into() } else { false.into() };
            let (status, answer) = page.wish(verb, &token(), &body(&lacking));
            assert_eq!(status, 422, "{answer}");
        }
        let mut long = whole.clone();
        long["by"] = "x".repeat(81).into();
        assert_eq!(page.wish(verb, &token(), &body(&long)).0, 422);
    }
    assert!(page.brain.wishes.try_recv().is_err(), "the mission heard nothing of it");
    let (address, said) = (page.address, body(&whole));
    let asked =
        std::thread::spawn(move || ask(address, "POST /api/wishes/fly-gaps", &token(), &said));
    let wish = page.brain.wishes.blocking_recv().unwrap();
    let said = wish.said.clone().unwrap();
    assert_eq!((said.verb, said.by.as_str()), (OperatorVerb::FlyGaps, "A. Pilot"));
    wish.answer(true, Phase::Preflight);
    assert_eq!(asked.join().unwrap().0, 200);
}

#[test]
fn holding_needs_no_fresh_eyes_and_the_missions_no_is_told() {
    let mut page = Page::open();
    assert_eq!(page.answered("hold", "{}", (true, Phase::Hold)).0, 200);
    let (status, answer) = page.answered("return", "{}", (false, Phase::Idle));
    assert_eq!(status, 409);
    assert!(answer.contains("not possible in the phase idle"), "{answer}");
    assert_eq!(page.wish("fly-away", &token(), "{}").0, 400);
    assert_eq!(page.wish("hold", &token(), "{\"force\":true}").0, 422);
}

#[test]
fn who_comes_from_elsewhere_is_refused_and_nothing_is_kept_by_browsers() {
    let page = Page::open();
    let evil = "Origin: http://evil.example\r\n";
    assert_eq!(page.ask("GET", "/api/state", evil, "").0, 403);
    assert_eq!(page.wish("hold", &(token() + evil), "{}").0, 403);
    assert_eq!(page.ask("GET", "/no-such-file", "", "").0, 404);
    // No flight has ended that could be decided on.
    let verdict = "{\"verdict\":\"accepted\"}";
    assert_eq!(page.ask("POST", "/api/review", &token(), verdict).0, 409);
    let (status, metrics) = page.ask("GET", "/metrics", "", "");
    assert_eq!(status, 200);
    let refused = "stockpilot_page_requests_refused_total 2";
    assert!(metrics.lines().any(|line| line == refused), "{metrics}");
    assert!(metrics.ends_with("# EOF\n"));
}

/// Viewers that keep up.
const N_VIEWERS: usize = 20;
/// Bounds a test that would otherwise wait for ever.
const PATIENCE: Duration = Duration::from_secs(60);

/// A browser's end of the live states.
struct Viewer(TcpStream);

impl Viewer {
    /// Opens the WebSocket; the system keeps so many bytes for it, if told so.
    fn open(address: SocketAddr, receive_buffer: Option<u32>) -> Self {
        let runtime = tokio::runtime::Builder::new_current_thread().enable_io().build().unwrap();
        let connected = runtime.block_on(async {
            let socket = TcpSocket::new_v4().unwrap();
            if let Some(bytes) = receive_buffer {
                socket.set_recv_buffer_size(bytes).unwrap();
            }
            socket.connect(address).await.unwrap().into_std().unwrap()
        });
        connected.set_nonblocking(false).unwrap();
        connected.set_read_timeout(Some(PATIENCE)).unwrap();
        let mut viewer = Self(connected);
        write!(
            viewer.0,
            "GET /api/live HTTP/1.1\r\nHost: {address}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n\
             Sec-WebSocket-Key: MDEyMzQ1Njc4OWFiY2RlZg==\r\nSec-WebSocket-Version: 13\r\n\r\n"
        )
        .unwrap();
        let mut head = Vec::new();
        while !head.ends_with(b"\r\n\r\n") {
            head.extend(viewer.take::<1>());
        }
        assert!(head.starts_with(b"HTTP/1.1 101 "), "{}", String::from_utf8_lossy(&head));
        viewer
    }

    fn take<const N: usize>(&mut self) -> [u8; N] {
        let mut bytes = [0; N];
        self.0.read_exact(&mut bytes).unwrap();
        bytes
    }

    /// The next state; answers what is asked between. RFC 6455, 5.2: a server's frames are not masked.
    fn next_state(&mut self) -> serde_json::Value {
        loop {
            let [kind, length] = self.take::<2>();
            let length = match length {
                126 => u64::from(u16::from_be_bytes(self.take())),
                127 => u64::from_be_bytes(self.take()),
                short => u64::from(short),
            };
            let mut payload = vec![0; usize::try_from(length).unwrap()];
            self.0.read_exact(&mut payload).unwrap();
            match kind & 0x0f {
                1 => return serde_json::from_slice(&payload).unwrap(),
                // A pong, masked with zeros.
                9 => self.0.write_all(&[0x8a, 0x80, 0, 0, 0, 0]).unwrap(),
                other => panic!("a frame of the kind {other}"),
            }
        }
    }

    /// Numbers of the states until one says that somebody was dropped.
    fn watch_until_one_is_dropped(mut self) -> Vec<u64> {
        let mut seen = Vec::new();
        loop {
            let state = self.next_state();
            seen.push(state["seq"].as_u64().unwrap());
            if state["viewers"]["dropped"] == 1 {
                return seen;
            }
        }
    }
}

#[test]
fn a_viewer_that_takes_nothing_is_dropped_and_twenty_others_are_served() {
    let page = Page::open();
    // With a long way ahead a state has some 30 kB, so that what waits for a viewer is soon too much.
    let ahead_m = vec![[1.234_567_8; 3]; 1_000];
    page.brain.feed.outlook(Outlook { ahead_m, ..page.outlook.clone() }, Pulse::default());
    let stalled = Viewer::open(page.address, Some(4_096));
    let viewers: Vec<Viewer> = (0..N_VIEWERS).map(|_| Viewer::open(page.address, None)).collect();
    let seen: Vec<Vec<u64>> = std::thread::scope(|scope| {
        let watch = |viewer: Viewer| scope.spawn(|| viewer.watch_until_one_is_dropped());
        let watching: Vec<_> = viewers.into_iter().map(watch).collect();
        watching.into_iter().map(|viewer| viewer.join().unwrap()).collect()
    });
    for seqs in &seen {
        let (first, last) = (seqs[0], seqs[seqs.len() - 1]);
        assert!(seqs.windows(2).all(|pair| pair[0] < pair[1]), "{seqs:?}");
        // Two seconds at least without taking anything; a busy machine may leave out a state for somebody.
        let n_told = last - first + 1;
        assert!(n_told >= 10 && 2 * seqs.len() as u64 >= n_told, "{n_told} told: {seqs:?}");
    }
    let (_, metrics) = page.ask("GET", "/metrics", "", "");
    let dropped = "stockpilot_page_viewers_dropped_total 1";
    assert!(metrics.lines().any(|line| line == dropped), "{metrics}");
    drop(stalled);
}
