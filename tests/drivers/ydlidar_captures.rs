//! YDLIDAR packets of a real T-mini Pro.

use crate::support::capture;
use stockpilot::lidar::Sample;
use stockpilot::lidar::ydlidar::{Geometry, PacketParser, SampleFormat};

fn packets(bytes: &[u8], chunk_bytes: usize) -> Vec<(f64, Vec<Sample>)> {
    // The parser is told the wrong format on purpose: the checksum must lead it to the right one.
    let mut parser = PacketParser::new(Geometry::TimeOfFlight, SampleFormat::Distance);
    let mut packets = Vec::new();
    for chunk in bytes.chunks(chunk_bytes) {
        parser.feed(chunk, |arrived| {
            packets.push((arrived.start_deg, arrived.samples.to_vec()));
        });
    }
    assert_eq!((parser.refused(), parser.skipped_bytes()), (0, 0));
    assert_eq!(parser.format(), SampleFormat::IntensityAndDistance);
    packets
}

#[test]
fn two_packets_are_read_with_their_intensities() {
    let names = [
        "ydlidar/tminipro_packet_0_3byte_samples.bin",
        "ydlidar/tminipro_packet_1_3byte_samples.bin",
    ];
    let [Some(first), Some(second)] = names.map(capture) else { return };
    let both = [first, second].concat();
    for chunk_bytes in [both.len(), 1, 5] {
        let packets = packets(&both, chunk_bytes);
        let sizes: Vec<usize> = packets.iter().map(|(_, samples)| samples.len()).collect();
        assert_eq!(sizes, [39, 40]);
        // By hand: FSA 28E3 is 5233/64°, LSA 39F3 is 7417/64°; samples `79 B6 05` and `66 A6 02`.
        let (start_deg, samples) = &packets[0];
        assert!((start_deg - 5233.0 / 64.0).abs() < 1e-9);
        assert_eq!((samples[0].intensity, samples[38].intensity), (0x79, 0x66));
        // 05B6 without its two flag bits is 1460 quarters of a millimetre.
        assert!((samples[0].range_m - 0.365).abs() < 1e-6);
        assert!((samples[38].range_m - f32::from(0x02A4_u16) * 0.000_25).abs() < 1e-6);
        assert!((f64::from(samples[38].clockwise_deg) - 7417.0 / 64.0).abs() < 1e-4);
    }
}
