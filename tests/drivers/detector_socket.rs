//! The detector input over real sockets.

use std::io::Write;
use std::net::UdpSocket;
use std::os::unix::net::{UnixDatagram, UnixStream};
use std::time::Duration;
use stockpilot::camera::{Address, CameraStats, Listener, Refusal, Settings};
use stockpilot::messages::TagDetections;
use stockpilot::pilot::Event;
use stockpilot::time::Stamp;
use tokio::sync::{mpsc, watch};
use tokio_util::sync::CancellationToken;

const LIMIT: Duration = Duration::from_secs(20);

fn line(id: u32) -> String {
    format!(
        "{{\"captured_at_ns\":900,\"clock\":\"mono\",\"camera\":0,\"tags\":[{{\"id\":{id},\
         \"family\":\"36h11\",\"corners_px\":[[1,2],[3,4],[5,6],[7,8]],\"decision_margin\":9}}]}}\n"
    )
}

struct Rig {
    events: mpsc::Receiver<Event>,
    stats: watch::Receiver<CameraStats>,
    cancel: CancellationToken,
    task: tokio::task::JoinHandle<std::io::Result<()>>,
    port: Option<std::net::SocketAddr>,
}

async fn rig(address: Address, channel_size: usize) -> Rig {
    let settings = Settings { address, image_sizes_px: vec![[1280, 720]] };
    let listener = Listener::bind(settings).await.unwrap();
    let (stats, port) = (listener.stats(), listener.local_addr());
    let (events_tx, events) = mpsc::channel(channel_size);
    let cancel = CancellationToken::new();
    let task = tokio::spawn(listener.run(|| Stamp::from_nanos(1000), events_tx, cancel.clone()));
    Rig { events, stats, cancel, task, port }
}

fn any_udp_port() -> Address {
    Address::Udp(([127, 0, 0, 1], 0).into())
}

impl Rig {
    async fn next_id(&mut self) -> u32 {
        match tokio::time::timeout(LIMIT, self.events.recv()).await.unwrap().unwrap() {
            Event::TagsSeen(TagDetections { tags, .. }) => tags[0].id,
            other => unreachable!("a detector sends tags only, not {other:?}"),
        }
    }

    async fn stats_when(&mut self, is_met: impl FnMut(&CameraStats) -> bool) -> CameraStats {
        tokio::time::timeout(LIMIT, self.stats.wait_for(is_met)).await.unwrap().unwrap().clone()
    }
}

#[tokio::test]
async fn a_datagram_may_hold_several_lines_and_bad_ones_harm_none() {
    let mut rig = rig(any_udp_port(), 16).await;
    let detector = UdpSocket::bind("127.0.0.1:0").unwrap();
    let datagram = format!("{}nonsense\n{}", line(1), line(2));
    detector.send_to(datagram.trim_end().as_bytes(), rig.port.unwrap()).unwrap();
    detector.send_to(&[0xFF; 300], rig.port.unwrap()).unwrap();
    detector.send_to(line(3).as_bytes(), rig.port.unwrap()).unwrap();
    assert_eq!([rig.next_id().await, rig.next_id().await, rig.next_id().await], [1, 2, 3]);
    let stats = rig.stats_when(|stats| stats.lines == 5).await;
    assert_eq!((stats.frames, stats.refused, stats.lost), (3, 2, 0));
    assert!(matches!(stats.last_refusal, Some(Refusal::Malformed { .. })));
}

#[tokio::test]
async fn a_unix_stream_may_cut_lines_anywhere() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("detections");
    let mut rig = rig(Address::UnixStream(path.clone()), 16).await;
    let mut detector = UnixStream::connect(&path).unwrap();
    let text = line(4);
    let (head, tail) = text.as_bytes().split_at(50);
    detector.write_all(head).unwrap();
    let mut other = UnixStream::connect(&path).unwrap();
    other.write_all(line(5).as_bytes()).unwrap();
    assert_eq!(rig.next_id().await, 5);
    detector.write_all(tail).unwrap();
    assert_eq!(rig.next_id().await, 4);
    // A giant line is refused once, and what follows on the same connection is taken.
    detector.write_all(&vec![b'x'; 200_000]).unwrap();
    detector.write_all(b"\n").unwrap();
    detector.write_all(line(6).as_bytes()).unwrap();
    assert_eq!(rig.next_id().await, 6);
    let stats = rig.stats_when(|stats| stats.refused == 1).await;
    assert!(matches!(stats.last_refusal, Some(Refusal::TooLong { .. })));
}

#[tokio::test]
async fn a_unix_datagram_socket_replaces_its_stale_file() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("detections");
    drop(UnixDatagram::bind(&path).unwrap());
    let mut rig = rig(Address::UnixDatagram(path.clone()), 16).await;
    let detector = UnixDatagram::unbound().unwrap();
    detector.send_to(line(8).as_bytes(), &path).unwrap();
    assert_eq!(rig.next_id().await, 8);
}

#[tokio::test]
async fn a_full_channel_loses_and_counts() {
    let mut rig = rig(any_udp_port(), 1).await;
    let detector = UdpSocket::bind("127.0.0.1:0").unwrap();
    let lines: String = (0..5).map(line).collect();
    detector.send_to(lines.as_bytes(), rig.port.unwrap()).unwrap();
    let stats = rig.stats_when(|stats| stats.lines == 5).await;
    assert_eq!((stats.frames, stats.lost), (1, 4));
}

#[tokio::test]
async fn cancelling_ends_the_task() {
    let rig = rig(any_udp_port(), 1).await;
    rig.cancel.cancel();
    tokio::time::timeout(LIMIT, rig.task).await.unwrap().unwrap().unwrap();
}

#[tokio::test]
async fn a_file_that_is_no_socket_is_never_removed() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("precious");
    std::fs::write(&path, "data").unwrap();
    let settings = Settings { address: Address::UnixStream(path.clone()), image_sizes_px: vec![] };
    assert!(Listener::bind(settings).await.is_err());
    assert_eq!(std::fs::read_to_string(&path).unwrap(), "data");
}
