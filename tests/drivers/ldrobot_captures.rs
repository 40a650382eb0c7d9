//! The parser on streams of real sensors.

use crate::support::capture;
use stockpilot::lidar::ldrobot::{Frame, Ldrobot, Parser, ParserStats};
use stockpilot::lidar::{Model, ScanAssembler, Sensor};
use stockpilot::time::Stamp;

fn frames_of(bytes: &[u8], chunk_bytes: usize) -> (Vec<Frame>, ParserStats) {
    let mut parser = Parser::new();
    let mut frames = Vec::new();
    for chunk in bytes.chunks(chunk_bytes) {
        parser.feed(chunk, |frame, _| frames.push(frame));
    }
    (frames, parser.stats())
}

#[test]
fn clean_capture_gives_863_frames() {
    let Some(bytes) = capture("ldrobot/example3.0.txt") else { return };
    let (frames, stats) = frames_of(&bytes, 4096);
    assert_eq!((frames.len(), stats.crc_errors), (863, 0));
    assert!(frames.iter().all(|frame| (3586..=3620).contains(&frame.speed_deg_per_s)));
}

#[test]
fn joined_capture_gives_8441_frames_and_3_bad_joins() {
    let Some(bytes) = capture("ldrobot/example2.0.txt") else { return };
    let (frames, stats) = frames_of(&bytes, 4096);
    assert_eq!((frames.len(), stats.crc_errors), (8441, 3));
}

#[test]
fn chance_crc_in_a_damaged_capture_is_refused() {
    // The file was run through a text converter. Of seven candidates one passes the CRC by chance;
    // its device time of 48,575 ms is beyond the wrap at 30,000.
    let Some(bytes) = capture("ldrobot/bad_data.txt") else { return };
    let (frames, stats) = frames_of(&bytes, 4096);
    assert_eq!((frames.len(), stats.implausible, stats.crc_errors), (0, 1, 6));
    assert!(stats.skipped_bytes > 900);
}

#[test]
fn manual_example_is_read() {
    let Some(bytes) = capture("ldrobot/manual_example_frame.bin") else { return };
    let (frames, _) = frames_of(&bytes, 4096);
    assert_eq!((frames[0].speed_deg_per_s, frames[0].timestamp_ms), (2152, 6714));
}

#[test]
fn chunking_changes_nothing_on_real_streams() {
    for name in ["example3.0.txt", "example2.0.txt", "bad_data.txt"] {
        let Some(bytes) = capture(&format!("ldrobot/{name}")) else { return };
        let whole = frames_of(&bytes, bytes.len());
        for chunk_bytes in [1, 3, 4096] {
            assert_eq!(frames_of(&bytes, chunk_bytes), whole, "{name} by {chunk_bytes}");
        }
    }
}

#[test]
fn decoded_numbers_equal_the_published_table() {
    let (Some(bytes), Some(table)) = (
        capture("ldrobot/example3.0.txt"),
        capture("ldrobot/example3.0_first50_frames_decoded.csv"),
    ) else {
        return;
    };
    let (frames, _) = frames_of(&bytes, 4096);
    let table = String::from_utf8(table).unwrap();
    let mut n_rows = 0;
    for row in table.lines().skip(1) {
        check_row(&frames, &row.split(',').map(|c| c.parse().unwrap()).collect::<Vec<f64>>());
        n_rows += 1;
    }
    assert_eq!(n_rows, 50 * 12);
}

/// A row: frame, offset, `speed_dps`, `start_deg`, `end_deg`, `ts_ms`, i, `angle_deg`, `dist_mm`,
/// intensity.
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "the table's columns are small whole numbers"
)]
fn check_row(frames: &[Frame], row: &[f64]) {
    let (frame, sample_idx) = (&frames[row[0] as usize], row[6] as usize);
    assert_eq!(frame.speed_deg_per_s, row[2] as u16);
    assert_eq!(frame.timestamp_ms, row[5] as u16);
    // The table has four decimals.
    assert!((frame.angle_deg(sample_idx) - row[7]).abs() < 1e-4, "{row:?}");
    assert_eq!(frame.samples[sample_idx].range_mm, row[8] as u16);
    assert_eq!(f64::from(frame.samples[sample_idx].intensity).to_bits(), row[9].to_bits());
}

#[test]
fn no_sample_of_the_clean_capture_counts_as_missing() {
    let Some(bytes) = capture("ldrobot/example3.0.txt") else { return };
    let mut assembler = ScanAssembler::new(230_400);
    let mut sensor = Ldrobot::new(Model::Ld19);
    let mut scans = Vec::new();
    for (i, frame) in frames_of(&bytes, 4096).0.iter().enumerate() {
        let at = Stamp::from_nanos(i64::try_from(i).unwrap() * 2_666_667);
        sensor.feed(&frame.to_bytes(), at, &mut |packet| {
            assembler.push(packet, |scan| scans.push(scan));
        });
    }
    assert_eq!(assembler.stats().missing_samples, 0);
    // 863 · 12 samples at 450 a turn are 23 turns.
    assert!((22..=24).contains(&scans.len()));
    // Ten turns a second at 4,500 samples/s; the head's speed varies by 1 %.
    let full = &scans[1..scans.len() - 1];
    assert!(full.iter().all(|scan| (440..=460).contains(&scan.beams.len())));
}
