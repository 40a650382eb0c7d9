//! Cameras whose tags are found here: pictures through a socket and a folder.

use std::io::Write;
use std::os::unix::net::UnixStream;
use std::path::Path;
use std::time::Duration;
use stockpilot::camera::images::{ImageDriver, ImageStats, Settings, Source};
use stockpilot::camera::picture::GreyPicture;
use stockpilot::camera::tag_finder;
use stockpilot::messages::{CameraId, TagDetections, TagFamily, TagPattern};
use stockpilot::pilot::Event;
use stockpilot::time::Stamp;
use tokio::sync::{mpsc, watch};
use tokio_util::sync::CancellationToken;

const LIMIT: Duration = Duration::from_secs(20);
const SIZE_PX: [u32; 2] = [120, 100];
/// The clock stands still here.
const NOW_NS: i64 = 5_000_000_000;

/// One tag with its upper left corner at (20, 10) and cells of 10 px.
fn picture(id: u32) -> GreyPicture {
    let pattern = TagPattern::new(TagFamily::Tag36h11, id).unwrap();
    let cell = |at: i32, from: i32| (at - from).div_euclid(10);
    let is_white = |col: i32, row: i32| pattern.is_white(cell(col, 20), cell(row, 10));
    let grey = |col, row| if is_white(col, row) { 220 } else { 30 };
    let pixels = (0..100).flat_map(|row| (0..120).map(move |col| grey(col, row))).collect();
    GreyPicture::new(120, 100, pixels).unwrap()
}

struct Rig {
    driver: ImageDriver,
    events: mpsc::Receiver<Event>,
    stats: watch::Receiver<ImageStats>,
    cancel: CancellationToken,
}

fn rig(source: Source, channel_size: usize) -> Rig {
    let settings = Settings {
        camera: CameraId(3),
        size_px: SIZE_PX,
        source,
        readout: Duration::ZERO,
        stamp_delay: Some(Duration::from_millis(20)),
        detector: tag_finder::Settings::default(),
    };
    let (events_tx, events) = mpsc::channel(channel_size);
    let cancel = CancellationToken::new();
    let now = || Stamp::from_nanos(NOW_NS);
    let driver = ImageDriver::start(settings, now, events_tx, &cancel).unwrap();
    let stats = driver.stats();
    Rig { driver, events, stats, cancel }
}

impl Rig {
    async fn next(&mut self) -> TagDetections {
        match tokio::time::timeout(LIMIT, self.events.recv()).await.unwrap().unwrap() {
            Event::TagsSeen(frame) => frame,
            other => unreachable!("a camera sends tags only, not {other:?}"),
        }
    }

    async fn stats_when(&mut self, is_met: impl FnMut(&ImageStats) -> bool) -> ImageStats {
        tokio::time::timeout(LIMIT, self.stats.wait_for(is_met)).await.unwrap().unwrap().clone()
    }

    fn end(self) {
        self.cancel.cancel();
        self.driver.stop();
    }
}

fn socket(folder: &Path) -> Source {
    Source::PgmStream { path: folder.join("pictures") }
}

#[tokio::test]
async fn pictures_on_a_socket_become_stamped_tags() {
    let folder = tempfile::tempdir().unwrap();
    let mut rig = rig(socket(folder.path()), 16);
    let mut stream = UnixStream::connect(folder.path().join("pictures")).unwrap();
    let at = Stamp::from_nanos(NOW_NS - 30_000_000);
    stream.write_all(&picture(7).to_pgm(Some(at))).unwrap();
    let frame = rig.next().await;
    assert_eq!((frame.camera, frame.captured_at), (CameraId(3), at));
    assert_eq!(frame.received_at, Stamp::from_nanos(NOW_NS));
    assert_eq!(frame.tags.iter().map(|tag| tag.id).collect::<Vec<_>>(), [7]);
    let lower_left = frame.tags[0].corners_px[0];
    assert!((lower_left[0] - 20.0).abs() < 0.2 && (lower_left[1] - 90.0).abs() < 0.2);

    // Without a stamp: the arrival less the delay. In pieces: the rest is waited for.
    let bytes = picture(8).to_pgm(None);
    stream.write_all(&bytes[..100]).unwrap();
    stream.write_all(&bytes[100..]).unwrap();
    let frame = rig.next().await;
    assert_eq!((frame.tags[0].id, frame.captured_at.nanos()), (8, NOW_NS - 20_000_000));

    // Another program may come when the first has gone.
    drop(stream);
    let mut stream = UnixStream::connect(folder.path().join("pictures")).unwrap();
    stream.write_all(&picture(9).to_pgm(Some(at))).unwrap();
    assert_eq!(rig.next().await.tags[0].id, 9);
    let stats = rig.stats_when(|stats| stats.frames == 3).await;
    assert_eq!((stats.pictures, stats.tags, stats.refused, stats.lost), (3, 3, 0, 0));
    rig.end();
}

#[tokio::test]
async fn wrong_sizes_wrong_stamps_and_rubbish_are_refused_and_counted() {
    let folder = tempfile::tempdir().unwrap();
    let mut rig = rig(socket(folder.path()), 16);
    let mut stream = UnixStream::connect(folder.path().join("pictures")).unwrap();
    let small = GreyPicture::new(16, 16, vec![0; 256]).unwrap();
    stream.write_all(&small.to_pgm(None)).unwrap();
    let stats = rig.stats_when(|stats| stats.refused == 1).await;
    assert!(stats.last_error.unwrap().contains("16"));
    let future = Stamp::from_nanos(NOW_NS + 1_000_000_000);
    stream.write_all(&picture(1).to_pgm(Some(future))).unwrap();
    let stats = rig.stats_when(|stats| stats.refused == 2).await;
    assert!(stats.last_error.unwrap().contains("ahead"));
    stream.write_all(b"GET / HTTP/1.1\n").unwrap();
    rig.stats_when(|stats| stats.refused == 3).await;
    let mut stream = UnixStream::connect(folder.path().join("pictures")).unwrap();
    stream.write_all(&picture(2).to_pgm(None)).unwrap();
    assert_eq!(rig.next().await.tags[0].id, 2, "the next one is unharmed");
    rig.end();
}

#[tokio::test]
async fn a_brain_that_does_not_listen_costs_frames_and_nothing_else() {
    let folder = tempfile::tempdir().unwrap();
    let mut rig = rig(socket(folder.path()), 1);
    let mut stream = UnixStream::connect(folder.path().join("pictures")).unwrap();
    for n in 1..=3 {
        stream.write_all(&picture(n).to_pgm(None)).unwrap();
        rig.stats_when(|stats| stats.frames + stats.lost == u64::from(n)).await;
    }
    let stats = rig.stats.borrow().clone();
    assert_eq!((stats.frames, stats.lost), (1, 2));
    rig.end();
}

#[tokio::test]
async fn every_picture_moved_into_a_folder_is_looked_at_and_old_ones_are_not() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("0.pgm"), picture(100).to_pgm(None)).unwrap();
    let mut rig = rig(Source::Folder { path: folder.path().to_owned() }, 64);
    for n in 1..=20_u32 {
        let (draft, done) =
            (folder.path().join("draft"), folder.path().join(format!("{n:03}.pgm")));
        std::fs::write(&draft, picture(n).to_pgm(None)).unwrap();
        std::fs::rename(draft, done).unwrap();
    }
    for n in 1..=20 {
        assert_eq!(rig.next().await.tags[0].id, n);
    }
    assert_eq!(rig.stats.borrow().skipped, 0);
    rig.end();
}

#[test]
fn a_source_that_is_not_there_is_told_at_the_start() {
    let settings = Settings {
        camera: CameraId(0),
        size_px: SIZE_PX,
        source: Source::Folder { path: "/nonexistent".into() },
        readout: Duration::ZERO,
        stamp_delay: None,
        detector: tag_finder::Settings::default(),
    };
    let (events, _kept) = mpsc::channel(1);
    let start = ImageDriver::start(settings, || Stamp::ZERO, events, &CancellationToken::new());
    assert!(start.is_err());
}
