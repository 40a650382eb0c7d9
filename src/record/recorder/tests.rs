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
fn a_full_disk_is_counted_and_blocks_nobody() {
    // The head takes some 30 kB; then the disk fills in different places of a chunk.
    (60_000..60_100).step_by(7).for_each(fill_a_disk_of);
}

fn fill_a_disk_of(room: u64) {
    let disk = SmallDisk { bytes: Cursor::default(), room };
    let log = LogWriter::begin(BufWriter::new(disk), &LogHeader::default()).unwrap();
    let mut recorder = Recorder::spawn(log, None, || Ok(())).unwrap();
    for n in 0..3000 {
        recorder.event(Stamp::from_nanos(n), &tick(n * n * 7919));
    }
    let stats = recorder.close();
    assert!(stats.has_failed);
    assert!(stats.lost_on_disk > 0);
    assert_eq!(stats.written + stats.lost_on_disk + stats.lost_in_queue, 3000);
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
