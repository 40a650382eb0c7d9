//! The HTTP server and its thread.

mod ask;
mod look;

pub(super) use ask::AskDoc;
pub(super) use look::LookDoc;

use super::access::{Access, Token};
use super::collector::Collector;
use super::earlier::Earlier;
use super::feed::{BrainEnd, Feed, News};
use super::maps::Maps;
use super::scene::Scene;
use super::settings::Settings;
use super::shared::{Parts, Shared, count};
use crate::camera::CameraStats;
use crate::lidar::LidarStatus;
use crate::mapping;
use crate::messages::GridGeometry;
use crate::planning::free_space::FreeSpace;
use axum::Router;
use axum::extract::{DefaultBodyLimit, Request, State};
use axum::http::HeaderValue;
use axum::http::header::{
    CONTENT_SECURITY_POLICY, REFERRER_POLICY, X_CONTENT_TYPE_OPTIONS, X_FRAME_OPTIONS,
};
use axum::middleware::{self, Next};
use axum::response::{IntoResponse, Response};
use axum::routing::{get, post};
use axum::serve::ListenerExt as _;
use std::io;
use std::net::SocketAddr;
use std::path::PathBuf;
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::Duration;
use tokio::net::{TcpListener, TcpSocket};
use tokio::sync::{mpsc, watch};
use tokio::time::{Instant, MissedTickBehavior, interval};
use tokio_util::sync::CancellationToken;

/// States come this often.
const STATE_EVERY: Duration = Duration::from_millis(200);
/// The disk is looked at this often.
const DISK_EVERY: Duration = Duration::from_secs(5);
/// Wishes that may wait for the brain; more people do not press at once.
const WISHES_WAITING: usize = 8;
/// Bytes that the system keeps for a viewer: some seconds of states, so that one that does not
/// keep up is soon noticed.
const SEND_BUFFER_BYTES: u32 = 64 * 1024;
/// Connections that wait to be taken.
const BACKLOG: u32 = 128;
/// No request is longer, bytes.
const LONGEST_REQUEST: usize = 4 * 1024;
/// How much the page stands back behind flying, as in `nice`.
const NICENESS: i32 = 10;
/// The page's own files and nothing else; the hash is that of the import map in `index.html`.
const POLICY: &str = "default-src 'none'; script-src 'self' 'sha256-eRHC8u2lqY54b7M+uHZC1fVgoIXfuAdb+RDlb54o14w='; style-src 'self'; \
     img-src 'self' data: blob:; connect-src 'self'; base-uri 'none'; form-action 'none'; \
     frame-ancestors 'none'";

/// What is watched beside the brain.
#[derive(Debug, Clone)]
pub struct Sensors {
    /// The LiDAR's driver.
    pub lidar: watch::Receiver<LidarStatus>,
    /// The detection listener.
    pub camera: watch::Receiver<CameraStats>,
}

/// What a page is made of, beside its settings.
#[derive(Debug)]
pub struct Surroundings {
    /// The hall.
    pub scene: Scene,
    /// The surveyed floor under its bays, to show how much lies on it.
    pub floor: Floor,
    /// Where a fix is good enough.
    pub space: Arc<FreeSpace>,
    /// What is watched beside the brain.
    pub sensors: Sensors,
    /// The log of this run.
    pub log: PathBuf,
    /// Cancelled to end the page.
    pub stop: CancellationToken,
}

/// A surveyed floor, if bays lie on one.
#[derive(Debug, Clone, Default)]
pub struct Floor(Option<Earlier>);

impl Floor {
    /// The floor of a brain's bays.
    #[must_use]
    pub fn new(settings: &mapping::Settings) -> Self {
        Self(Earlier::of_base(settings, &settings.region.grid(settings.cell_m)))
    }
}

/// A page at work.
#[derive(Debug)]
pub struct RunningPage {
    address: SocketAddr,
    thread: JoinHandle<()>,
}

impl RunningPage {
    /// Where it is served.
    #[must_use]
    pub const fn address(&self) -> SocketAddr {
        self.address
    }

    /// Waits until the page has ended. Blocks.
    pub fn join(self) {
        if self.thread.join().is_err() {
            tracing::error!("the page's thread died");
        }
    }
}

/// Starts the page's thread; what the brain needs of it comes back.
///
/// # Errors
/// The address cannot be had, or there is no thread.
pub fn start(settings: &Settings, around: Surroundings) -> io::Result<(BrainEnd, RunningPage)> {
    let Surroundings { scene, floor, space, sensors, log, stop } = around;
    let floor = floor.0;
    let (last_survey, grid) = (settings.last_survey.clone(), scene.grid);
    let (feed, news) = Feed::new();
    let (wishes_tx, wishes) = mpsc::channel(WISHES_WAITING);
    let name = log.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let maps = Maps::new(space, floor);
    let access = Access { token: token(settings), host_names: settings.host_names.clone() };
    let shared = Arc::new(Shared::new(Parts {
        collector: Collector::new(scene, maps, settings.target_percent, name),
        access,
        wishes: wishes_tx,
        sensors,
        feed: feed.clone(),
        log,
        stop,
    }));
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
    let (bound_tx, bound) = std::sync::mpsc::sync_channel(1);
    let listen = settings.listen;
    let thread = std::thread::Builder::new().name("page".to_owned()).spawn(move || {
        stand_back();
        runtime.block_on(async move {
            let listener = match bind(listen) {
                Ok(listener) => listener,
                Err(error) => return drop(bound_tx.send(Err(error))),
            };
            drop(bound_tx.send(listener.local_addr()));
            if let Some(log) = last_survey {
                tokio::spawn(compare(Arc::clone(&shared), log, grid));
            }
            run(listener, shared, news).await;
        });
    })?;
    let address = bound.recv().map_err(|_| io::Error::other("the page's thread died"))??;
    Ok((BrainEnd { feed, wishes }, RunningPage { address, thread }))
}

/// A broken token closes the controls but never keeps a flight from its page.
fn token(settings: &Settings) -> Option<Token> {
    let path = settings.token_file.as_ref()?;
    match Token::read(path) {
        Ok(token) => Some(token),
        Err(error) => {
            tracing::error!(%error, "the page can only be looked at");
            None
        }
    }
}

fn stand_back() {
    if let Err(error) = rustix::process::setpriority_process(None, NICENESS) {
        tracing::debug!(%error, "the page's thread keeps its priority");
    }
}

fn bind(address: SocketAddr) -> io::Result<TcpListener> {
    let socket = if address.is_ipv4() { TcpSocket::new_v4() } else { TcpSocket::new_v6() }?;
    socket.set_reuseaddr(true)?;
    // Connections inherit it.
    socket.set_send_buffer_size(SEND_BUFFER_BYTES)?;
    socket.bind(address)?;
    socket.listen(BACKLOG)
}

async fn run(listener: TcpListener, shared: Arc<Shared>, news: mpsc::Receiver<News>) {
    let stop = shared.stop.clone();
    let taking = tokio::spawn(take_news(Arc::clone(&shared), news));
    let showing = tokio::spawn(show_states(Arc::clone(&shared)));
    let listener = listener.tap_io(|connection| {
        if let Err(error) = connection.set_nodelay(true) {
            tracing::debug!(%error, "a viewer's connection keeps its delay");
        }
    });
    let serving = axum::serve(listener, router(shared)).with_graceful_shutdown({
        let stop = stop.clone();
        async move { stop.cancelled().await }
    });
    tokio::select! {
        result = serving => {
            if let Err(error) = result {
                tracing::error!(%error, "the page's server broke");
            }
        }
        // A viewer that does not close its connection is not waited for.
        () = async { stop.cancelled().await; tokio::time::sleep(STATE_EVERY).await } => {}
    }
    stop.cancelled().await;
    taking.abort();
    showing.abort();
}

/// Reads the last survey beside the page, which is served meanwhile.
async fn compare(shared: Arc<Shared>, log: PathBuf, grid: GridGeometry) {
    let read = tokio::task::spawn_blocking(move || {
        stand_back();
        Earlier::of_survey(&log, &grid)
    });
    match read.await {
        Ok(Ok(earlier)) => shared.collector().maps.compare_with(earlier),
        Ok(Err(error)) => tracing::warn!(%error, "the page shows no change since the last survey"),
        Err(error) => tracing::error!(%error, "the last survey could not be read"),
    }
}

/// Takes in what the brain tells.
async fn take_news(shared: Arc<Shared>, mut news: mpsc::Receiver<News>) {
    while let Some(next) = news.recv().await {
        shared.collector().take(next, Instant::now());
    }
}

/// Encodes the state for everybody, while there is somebody.
async fn show_states(shared: Arc<Shared>) {
    let mut due = interval(STATE_EVERY);
    due.set_missed_tick_behavior(MissedTickBehavior::Skip);
    let mut disk_looked_at: Option<Instant> = None;
    loop {
        due.tick().await;
        shared.collector().seq += 1;
        if disk_looked_at.is_none_or(|at| at.elapsed() >= DISK_EVERY) {
            disk_looked_at = Some(Instant::now());
            shared.look_at_disk();
        }
        if shared.states.receiver_count() > 0 {
            match serde_json::to_string(&shared.picture()) {
                Ok(text) => drop(shared.states.send_replace(text.into())),
                Err(error) => tracing::error!(%error, "a state could not be encoded"),
            }
        }
    }
}

fn router(shared: Arc<Shared>) -> Router {
    Router::new()
        .route("/api/state", get(look::state))
        .route("/api/scene", get(look::scene))
        .route("/api/series", get(look::series))
        .route("/api/accounts", get(look::accounts))
        .route("/api/maps/{kind}", get(look::map))
        .route("/api/live", get(look::live))
        .route("/api/openapi.json", get(look::openapi))
        .route("/metrics", get(look::metrics))
        .route("/api/token", post(ask::token))
        .route("/api/wishes/{verb}", post(ask::wish))
        .route("/api/review", post(ask::review))
        .fallback(get(look::asset))
        .layer(DefaultBodyLimit::max(LONGEST_REQUEST))
        .layer(middleware::from_fn_with_state(Arc::clone(&shared), guard))
        .with_state(shared)
}

/// Stands before everything: counts, judges who may look, and adds what browsers must keep.
async fn guard(State(shared): State<Arc<Shared>>, request: Request, next: Next) -> Response {
    count(&shared.counters.requests);
    let mut response = match shared.access.may_look(request.headers()) {
        Ok(()) => next.run(request).await,
        Err(refusal) => {
            count(&shared.counters.refused);
            (refusal.status(), refusal.to_string()).into_response()
        }
    };
    let headers = response.headers_mut();
    headers.insert(CONTENT_SECURITY_POLICY, HeaderValue::from_static(POLICY));
    headers.insert(X_CONTENT_TYPE_OPTIONS, HeaderValue::from_static("nosniff"));
    headers.insert(X_FRAME_OPTIONS, HeaderValue::from_static("DENY"));
    headers.insert(REFERRER_POLICY, HeaderValue::from_static("no-referrer"));
    response
}
