//! The channels of the log as they are written, for Foxglove and its forks: the same names, schemas and
//! bytes, by Foxglove's WebSocket protocol.
//!
//! ```text
//! brain ─▶ thread `log` ─ bytes ─▶ file
//!                          └─────▶ queue of each viewer (1,024, the oldest go) ─▶ thread `foxglove`
//! ```
//! The brain knows nothing of it. Viewers can only look: nothing of what they send is taken. Whoever
//! subscribes gets the newest message at once of those channels that speak seldom.
//!
//! Nobody is asked for a token, and pages of other sites may connect, as Foxglove's own does: whoever
//! reaches the address sees the flight.

use super::entry::Written;
use super::topic::Topic;
use super::view::ViewTopic;
use crate::time::{Mono, Stamp};
use foxglove::websocket::{ChannelView, Client, ServerListener};
use foxglove::{ChannelBuilder, Context, PartialMetadata, RawChannel, Schema};
use std::collections::BTreeMap;
use std::io;
use std::net::SocketAddr;
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;
use tokio_util::sync::{CancellationToken, DropGuard};

/// Messages that wait for one viewer; beyond that the oldest are dropped.
const BACKLOG: usize = 1_024;
/// Viewers that have not closed by then are left behind.
const END_WITHIN: Duration = Duration::from_millis(500);
/// Viewers have so long to take what was written last.
const LAST_WORDS_WITHIN: Duration = Duration::from_millis(200);
/// How much the viewers stand back behind flying, as in `nice`.
const NICENESS: i32 = 10;

/// The newest bytes of a channel, and when they were written, ns.
type Newest = (Arc<RawChannel>, Option<(u64, Vec<u8>)>);

/// Where the log's thread shows what it writes.
#[derive(Debug)]
pub struct LiveView {
    channels: BTreeMap<Topic, Arc<RawChannel>>,
    views: BTreeMap<ViewTopic, Arc<RawChannel>>,
    kept: Arc<Kept>,
}

/// What those get who come later.
#[derive(Debug)]
struct Kept {
    newest: Mutex<BTreeMap<String, Newest>>,
}

/// A server at work.
#[derive(Debug)]
pub struct RunningLive {
    address: SocketAddr,
    thread: JoinHandle<()>,
    stop: DropGuard,
}

impl RunningLive {
    /// Where it listens.
    #[must_use]
    pub const fn address(&self) -> SocketAddr {
        self.address
    }

    /// Ends it, and waits until it has ended. Blocks. Call it when the last entry has been written.
    pub fn join(self) {
        drop(self.stop);
        if self.thread.join().is_err() {
            tracing::error!("the thread of the live log died");
        }
    }
}

impl LiveView {
    /// Serves the channels at an address until the other half is joined or dropped.
    ///
    /// # Errors
    /// The address cannot be had, or there is no thread.
    pub fn serve(listen: SocketAddr) -> io::Result<(Self, RunningLive)> {
        let stop = CancellationToken::new();
        let guard = stop.clone().drop_guard();
        let context = Context::new();
        let view = Self::new(&context).map_err(io::Error::other)?;
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
        let (bound_tx, bound) = std::sync::mpsc::sync_channel(1);
        let kept = Arc::clone(&view.kept);
        let thread = std::thread::Builder::new().name("foxglove".to_owned()).spawn(move || {
            stand_back();
            runtime.block_on(async move {
                let server = context
                    .websocket_server()
                    .name("stockpilot")
                    .bind(listen.ip().to_string(), listen.port())
                    .message_backlog_size(BACKLOG)
                    .tokio_runtime(&tokio::runtime::Handle::current())
                    .listener(kept)
                    .start()
                    .await;
                match server {
                    Ok(server) => {
                        drop(bound_tx.send(Ok(SocketAddr::new(listen.ip(), server.port()))));
                        stop.cancelled().await;
                        // What was written last is still on its way to the viewers.
                        tokio::time::sleep(LAST_WORDS_WITHIN).await;
                        // A viewer that takes nothing does not keep the program from its end.
                        let closed = tokio::time::timeout(END_WITHIN, server.stop().wait()).await;
                        tracing::debug!(all_closed = closed.is_ok(), "the live log ends");
                    }
                    Err(error) => drop(bound_tx.send(Err(io::Error::other(error)))),
                }
            });
        })?;
        let lost = |_| io::Error::other("the thread of the live log died");
        let address = bound.recv().map_err(lost)??;
        Ok((view, RunningLive { address, thread, stop: guard }))
    }

    fn new(context: &Arc<Context>) -> Result<Self, Box<dyn std::error::Error + Send + Sync>> {
        let mut channels = BTreeMap::new();
        for topic in Topic::ALL {
            let schema = serde_json::to_vec(&topic.schema())?;
            let builder = ChannelBuilder::new(topic.name())
                .context(context)
                .message_encoding("json")
                .schema(Schema::new(topic.schema_name(), "jsonschema", schema));
            channels.insert(*topic, builder.build_raw()?);
        }
        let mut views = BTreeMap::new();
        for topic in ViewTopic::ALL {
            let builder = ChannelBuilder::new(topic.name())
                .context(context)
                .message_encoding("protobuf")
                .schema(topic.schema());
            views.insert(topic, builder.build_raw()?);
        }
        let seldom = Topic::ALL.iter().filter(|topic| speaks_seldom(**topic));
        let seldom = seldom.map(|topic| &channels[topic]).chain([&views[&ViewTopic::Surface]]);
        let newest =
            seldom.map(|channel| (channel.topic().to_owned(), (Arc::clone(channel), None)));
        let newest = newest.collect();
        Ok(Self { channels, views, kept: Arc::new(Kept { newest: Mutex::new(newest) }) })
    }

    /// Shows what is written at `at`.
    pub(super) fn show(&self, at: Stamp<Mono>, written: &Written) {
        if let Some(channel) = self.channels.get(&written.encoded.topic) {
            self.send(channel, at, &written.encoded.json);
        }
        for (topic, bytes) in &written.views {
            if let Some(channel) = self.views.get(topic) {
                self.send(channel, at, bytes);
            }
        }
    }

    fn send(&self, channel: &RawChannel, at: Stamp<Mono>, bytes: &[u8]) {
        let time = u64::try_from(at.nanos()).unwrap_or(0);
        self.kept.keep(channel.topic(), time, bytes);
        if channel.has_sinks() {
            channel.log_with_meta(bytes, PartialMetadata { log_time: Some(time) });
        }
    }
}

/// Channels whose newest message says how things stand.
const fn speaks_seldom(topic: Topic) -> bool {
    matches!(
        topic,
        Topic::Config
            | Topic::Phase
            | Topic::Plan
            | Topic::Surface
            | Topic::Accounts
            | Topic::Vehicle
            | Topic::Ended
    )
}

impl Kept {
    fn keep(&self, topic: &str, time: u64, bytes: &[u8]) {
        let mut newest = self.newest.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((_, kept)) = newest.get_mut(topic) {
            *kept = Some((time, bytes.to_vec()));
        }
    }
}

impl ServerListener for Kept {
    fn on_subscribe(&self, client: Client, channel: ChannelView<'_>) {
        let kept = self.newest.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((channel, Some((time, bytes)))) = kept.get(channel.topic()) {
            let meta = PartialMetadata { log_time: Some(*time) };
            channel.log_with_meta_to_sink(bytes, meta, client.sink_id());
        }
    }
}

fn stand_back() {
    if let Err(error) = rustix::process::setpriority_process(None, NICENESS) {
        tracing::debug!(%error, "the live log's thread keeps its priority");
    }
}
