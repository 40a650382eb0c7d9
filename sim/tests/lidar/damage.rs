//! Damaged lines: nothing false is believed, and everything comes back.

use crate::support::{Bench, Clean, Line, Noisy};
use stockpilot::lidar::Model;
use stockpilot::stats::{Noise, SeedBook};

/// One model of every protocol with a checksum, and every kind of it.
const GUARDED: [Model; 7] = [
    Model::Ld19,
    Model::Stl27l,
    Model::RplidarA3,
    Model::RplidarS1,
    Model::YdlidarX4,
    Model::YdlidarTminiPro,
    Model::HokuyoUtm30lx,
];

/// Flips exactly one bit in every third frame: any checksum sees that.
struct OneBit {
    noise: Noise,
    n_frames: u64,
}

impl Line for OneBit {
    fn carry(&mut self, mut bytes: Vec<u8>) -> Vec<u8> {
        self.n_frames += 1;
        let n_bytes = bytes.len() as u64;
        if self.n_frames.is_multiple_of(3) && n_bytes > 0 {
            let at = usize::try_from(self.noise.bits() % n_bytes).unwrap();
            bytes[at] ^= 1 << (self.noise.bits() % 8);
        }
        bytes
    }
}

#[test]
fn one_wrong_bit_in_a_frame_never_becomes_a_range() {
    for model in GUARDED {
        let mut bench = Bench::new(model);
        bench.run(4.0, &mut Clean);
        let scans_before = bench.scans.len();
        let noise = SeedBook::new(11).stream("bits");
        bench.run(4.0, &mut OneBit { noise, n_frames: 0 });
        let counts = bench.sensor.counts();
        assert!(counts.checksum_errors > 5, "{model:?}: {counts:?}");
        assert!(bench.scans.len() > scans_before, "{model:?} has stopped");
        let (_, _, _, largest) = bench.errors_mm();
        println!("{:18} {counts:?}, largest error {largest:.1} mm", model.name());
        // The same bound as on a clean line.
        assert!(largest < 40.0, "{model:?}: {largest} mm");
    }
}

#[test]
fn one_percent_of_wrong_bytes_and_half_frames_are_survived() {
    for model in Model::ALL {
        let mut bench = Bench::new(model);
        bench.run(4.0, &mut Clean);
        for (byte_ratio, half_ratio) in [(0.01, 0.0), (0.0, 0.2)] {
            let mut line = Noisy::new(byte_ratio, half_ratio);
            // Recovered within two seconds, again and again.
            for _ in 0..3 {
                let before = bench.assembler.stats().beams;
                bench.run(2.0, &mut line);
                let n = bench.assembler.stats().beams - before;
                // A UTM-30LX block of 3,372 bytes never comes through with 1 % of them wrong.
                let is_hopeless = model.family() == stockpilot::lidar::Family::Hokuyo;
                assert!(n > 0 || (is_hopeless && byte_ratio > 0.0), "{model:?} {byte_ratio}");
            }
        }
        let before = bench.assembler.stats().beams;
        bench.run(5.0, &mut Clean);
        let n = bench.assembler.stats().beams - before;
        println!("{:18} {n} beams afterwards, {:?}", model.name(), bench.sensor.counts());
        assert!(n > 2 * u64::from(model.samples_per_s()) / 2, "{model:?}: {n}");
    }
}

#[test]
fn garbage_between_frames_costs_little_and_a_start_in_the_middle_nothing() {
    struct Garbage(Noise);
    impl Line for Garbage {
        fn carry(&mut self, bytes: Vec<u8>) -> Vec<u8> {
            if !self.0.chance(0.1) {
                return bytes;
            }
            let n = self.0.bits() % 60;
            let garbage = (0..n).map(|_| self.0.bits().to_le_bytes()[0]);
            garbage.chain(bytes).collect()
        }
    }
    for model in GUARDED {
        let mut bench = Bench::new(model);
        bench.run(4.0, &mut Clean);
        let before = bench.assembler.stats().beams;
        bench.run(2.0, &mut Garbage(SeedBook::new(5).stream("garbage")));
        let n = bench.assembler.stats().beams - before;
        let n_sent = 2 * u64::from(model.samples_per_s());
        assert!(n > n_sent / 3, "{model:?}: {n} of {n_sent}");
        let (_, _, _, largest) = bench.errors_mm();
        assert!(largest < 40.0, "{model:?}: {largest} mm");
    }
}
