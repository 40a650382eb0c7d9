//! The live states by WebSocket.

use super::shared::{Shared, count};
use axum::extract::ws::{CloseFrame, Message, WebSocket, close_code};
use std::sync::Arc;
use std::time::Duration;
use tokio::time::{Instant, MissedTickBehavior, interval, timeout};

/// A viewer whose connection takes nothing for so long does not keep up.
const SEND_WITHIN: Duration = Duration::from_secs(2);
/// Viewers are asked for a sign of life …
const PING_EVERY: Duration = Duration::from_secs(3);
/// … and one that gives none for so long has gone.
const HEARD_WITHIN: Duration = Duration::from_secs(10);

/// How a viewer's connection ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum End {
    Left,
    Dropped,
    Stopped,
}

/// Sends every state that the viewer is there for, until it leaves or does not keep up.
pub(super) async fn serve(mut socket: WebSocket, shared: Arc<Shared>) {
    let Some(_seat) = shared.enter() else {
        let reason = "too many viewers".into();
        let frame = CloseFrame { code: close_code::AGAIN, reason };
        // It is turned away either way.
        drop(timeout(SEND_WITHIN, socket.send(Message::Close(Some(frame)))).await);
        return;
    };
    let end = show(&mut socket, &shared).await;
    if end == End::Dropped {
        count(&shared.counters.viewers_dropped);
        tracing::info!("a viewer of the page did not keep up and was dropped");
    }
}

async fn show(socket: &mut WebSocket, shared: &Shared) -> End {
    let mut states = shared.states.subscribe();
    let mut ping = interval(PING_EVERY);
    ping.set_missed_tick_behavior(MissedTickBehavior::Delay);
    let mut heard_at = Instant::now();
    loop {
        let message = tokio::select! {
            () = shared.stop.cancelled() => return End::Stopped,
            changed = states.changed() => {
                if changed.is_err() {
                    return End::Stopped;
                }
                count(&shared.counters.states_sent);
                Message::Text(states.borrow_and_update().clone())
            }
            _ = ping.tick() => {
                if heard_at.elapsed() > HEARD_WITHIN {
                    return End::Dropped;
                }
                Message::Ping(axum::body::Bytes::new())
            }
            heard = socket.recv() => match heard {
                Some(Ok(Message::Close(_)) | Err(_)) | None => return End::Left,
                // What it says has no meaning; that it says something has.
                Some(Ok(_)) => {
                    heard_at = Instant::now();
                    continue;
                }
            },
        };
        match timeout(SEND_WITHIN, socket.send(message)).await {
            Ok(Ok(())) => {}
            Ok(Err(_)) => return End::Left,
            Err(_) => return End::Dropped,
        }
    }
}
