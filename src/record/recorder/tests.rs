use super::*;
use std::io::SeekFrom;

/// A disk with room for so many bytes.
#[derive(Debug)]
struct SmallDisk {
    room: usize,
    at: u64,
}

impl Write for SmallDisk {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        if bytes.len() > self.room {
            return Err(io::ErrorKind::StorageFull.into());
        }
        self.room -= bytes.len();
        self.at += bytes.len() as u64;
        Ok(bytes.len())
    }
    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl Seek for SmallDisk {
    fn seek(&mut self, _to: SeekFrom) -> io::Result<u64> {
        Ok(self.at)
    }
}

fn tick(n: i64) -> Event {
    Event::Ticked(Stamp::from_nanos(n))
}

#[test]
fn a_full_disk_is_counted_and_blocks_nobody() {
    let disk = SmallDisk { room: 60_000, at: 0 };
    let log = LogWriter::begin(disk, &LogHeader::default()).unwrap();
    let mut recorder = Recorder::spawn(log, || Ok(())).unwrap();
    let text = Action::Say(crate::messages::StatusText {
        severity: crate::messages::Severity::Info,
        text: (0..4000).map(|i| char::from(b'a' + u8::try_from(i * i % 23).unwrap())).collect(),
    });
    for n in 0..5000 {
        recorder.result(Stamp::from_nanos(n), &text);
    }
    let stats = recorder.close();
    assert!(stats.has_failed);
    assert!(stats.lost_on_disk > 0);
    assert_eq!(stats.written + stats.lost_on_disk + stats.lost_in_queue, 5000);
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
    };
    (0..5).for_each(|n| recorder.event(Stamp::ZERO, &tick(n)));
    assert_eq!(recorder.stats().lost_in_queue, 3);
    let gaps: Vec<u64> = jobs.try_iter().map(|job| lost_before(&job)).collect();
    assert_eq!(gaps, [0, 0]);
    recorder.event(Stamp::ZERO, &tick(5));
    assert_eq!(lost_before(&jobs.recv().unwrap()), 3);
    recorder.event(Stamp::ZERO, &tick(6));
    assert_eq!(lost_before(&jobs.recv().unwrap()), 0);
}

fn lost_before(job: &Job) -> u64 {
    match job {
        Job::Write { lost_before, .. } => *lost_before,
        Job::Flush => 0,
    }
}
