use super::*;
use std::io::{Cursor, SeekFrom};

/// A disk with room for so many bytes.
#[derive(Debug)]
struct SmallDisk {
    bytes: Cursor<Vec<u8>>,
    room: u64,
}

impl Write for SmallDisk {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let left = usize::try_from(self.room.saturating_sub(self.bytes.position())).unwrap();
        if left == 0 {
            return Err(io::ErrorKind::StorageFull.into());
        }
        self.bytes.write(&bytes[..bytes.len().min(left)])
    }
    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl Seek for SmallDisk {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        self.bytes.seek(to)
    }
}

fn tick(n: i64) -> Event {
    Event::Ticked(Stamp::from_nanos(n))
}

#[test]
fn what_becomes_known_later_is_noted_and_the_newest_holds() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("flight-1.mcap");
    let notes = [("started_utc".to_owned(), "2026-03-01T06:00:00Z".to_owned())].into();
    let mut recorder =
        Recorder::create(&path, &LogHeader { notes, ..LogHeader::default() }).unwrap().waiting();
    let noted = recorder.notes();
    for n in 0..3 {
        recorder.event(Stamp::ZERO, &Event::Ticked(Stamp::ZERO));
        noted.add("lidar", &format!("LD{n}"));
    }
    assert_eq!(recorder.close().lost_on_disk, 0);
    // After the end nobody reads them, and nobody waits.
    noted.add("lidar", "none");
    let mut reader = crate::record::LogReader::open(&path).unwrap();
    assert_eq!(reader.by_ref().count(), 4, "the configuration and three events");
    assert!(reader.is_complete(), "{:?}", reader.damage());
    assert_eq!(reader.notes()["lidar"], "LD2");
    assert_eq!(reader.notes()["started_utc"], "2026-03-01T06:00:00Z");
}

#[test]
fn a_full_disk_is_counted_and_blocks_nobody() {
    // The head takes some 30 kB; then the disk fills in different places of a chunk.
    (60_000..60_100).step_by(7).for_each(fill_a_disk_of);
}

fn fill_a_disk_of(room: u64) {
    let disk = SmallDisk { bytes: Cursor::default(), room };
    let log = LogWriter::begin(BufWriter::new(disk), &LogHeader::default()).unwrap();
    let mut recorder = Recorder::spawn(log, Viewed::default(), || Ok(())).unwrap();
    for n in 0..3000 {
        recorder.event(Stamp::from_nanos(n), &tick(n * n * 7919));
    }
    let stats = recorder.close();
    assert!(stats.has_failed);
    assert!(stats.lost_on_disk > 0);
    assert_eq!(stats.written + stats.lost_on_disk + stats.lost_in_queue, 3000);
}

/// What has left the program, for somebody else to look at.
#[derive(Debug, Clone, Default)]
struct SharedDisk(Arc<Mutex<Cursor<Vec<u8>>>>);

impl SharedDisk {
    fn cursor(&self) -> MutexGuard<'_, Cursor<Vec<u8>>> {
        self.0.lock().unwrap()
    }
}

impl Write for SharedDisk {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.cursor().write(bytes)
    }
    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl Seek for SharedDisk {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        self.cursor().seek(to)
    }
}

#[test]
fn the_end_of_a_log_is_brought_to_the_disk() {
    let disk = SharedDisk::default();
    let log = LogWriter::begin(BufWriter::new(disk.clone()), &LogHeader::default()).unwrap();
    let (synced, n_synced) = channel();
    let seen = disk.clone();
    let sync = move || synced.send(seen.cursor().get_ref().len()).map_err(io::Error::other);
    let mut recorder = Recorder::spawn(log, Viewed::default(), sync).unwrap();
    (0..100).for_each(|n| recorder.event(Stamp::from_nanos(n), &tick(n)));
    assert_eq!(recorder.close().written, 100);
    let bytes = disk.cursor().get_ref().clone();
    assert!(bytes.ends_with(b"\x89MCAP0\r\n"));
    assert_eq!(n_synced.try_iter().last(), Some(bytes.len()));
}

#[test]
fn a_full_queue_is_counted_and_told_with_the_next_entry() {
    // Nobody reads the queue until it is full.
    let (queue, jobs) = sync_channel(2);
    let counts = Arc::new(Counts::default());
    let mut recorder = Recorder {
        queue: Some(queue),
        metronome_stop: None,
        threads: Vec::new(),
        notes: LogNotes::default(),
        counts,
        lost_here: 0,
        last_lost_at: Stamp::ZERO,
        waits: false,
    };
    (0..5).for_each(|n| recorder.event(Stamp::ZERO, &tick(n)));
    assert_eq!(recorder.stats().lost_in_queue, 3);
    let gaps: Vec<u64> = jobs.try_iter().map(|job| lost_before(&job)).collect();
    assert_eq!(gaps, [0, 0]);
    recorder.event(Stamp::ZERO, &tick(5));
    assert_eq!(lost_before(&jobs.recv().unwrap()), 3);
    recorder.event(Stamp::ZERO, &tick(6));
    assert_eq!(lost_before(&jobs.recv().unwrap()), 0);
    // A gap at the very end is told too, though no entry follows it.
    (0..4).for_each(|n| recorder.event(Stamp::ZERO, &tick(n)));
    let ending = thread::spawn(move || drop(recorder));
    let last = jobs.iter().last().unwrap();
    ending.join().unwrap();
    assert!(matches!(last, Job::EndGap { n_entries: 2, .. }));
}

fn lost_before(job: &Job) -> u64 {
    match job {
        Job::Write { lost_before, .. } => *lost_before,
        Job::EndGap { .. } | Job::Flush => 0,
    }
}
