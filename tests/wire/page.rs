//! The live page's server over real connections, with a mission that says what the test wants.

use std::io::{Read as _, Write as _};
use std::net::{SocketAddr, TcpStream};
use std::os::unix::fs::PermissionsExt as _;
use stockpilot::camera::CameraStats;
use stockpilot::config::Config;
use stockpilot::lidar::LidarStatus;
use stockpilot::mission::Phase;
use stockpilot::pilot::Pilot;
use stockpilot::web::{self, BrainEnd, Floor, RunningPage, Scene, Sensors, Settings, Surroundings};
use tokio::sync::watch;
use tokio_util::sync::CancellationToken;

const TOKEN: &str = "0123456789abcdef";

struct Page {
    brain: BrainEnd,
    running: Option<RunningPage>,
    address: SocketAddr,
    stop: CancellationToken,
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
        let around = Surroundings {
            scene: Scene::new(&pilot),
            floor: Floor::new(&pilot.mapping),
            space: Pilot::new(pilot).free_space(),
            sensors: Sensors {
                lidar: watch::channel(LidarStatus::default()).1,
                camera: watch::channel(CameraStats::default()).1,
            },
            log: folder.path().join("flight.mcap"),
            stop: stop.clone(),
        };
        let (brain, running) = web::start(&settings, around).unwrap();
        let address = running.address();
        Self { brain, running: Some(running), address, stop, _folder: folder }
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
    let seen = format!("{{\"seq\":{}}}", state["seq"]);
    let (status, answer) = page.answered("start", &seen, (true, Phase::Preflight));
    assert_eq!(status, 200, "{answer}");
    let answer: serde_json::Value = serde_json::from_str(&answer).unwrap();
    assert_eq!((&answer["is_accepted"], &answer["phase"]), (&true.into(), &"preflight".into()));
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
