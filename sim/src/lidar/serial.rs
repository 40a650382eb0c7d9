//! An emulated sensor on a pseudo-terminal: firmware, transmitter and line.

use super::uart::Uart;
use super::{Device, Firmware, LidarModel, LineCounts, LineFaults, Mishap, PtyLine, Scene, device};
use std::path::Path;
use stockpilot::stats::SeedBook;
use stockpilot::time::{Mono, Stamp};

/// Full-speed USB, bit/s.
const USB_SPEED: u32 = 12_000_000;

/// A Hokuyo is plugged in by USB: its bytes leave at USB's speed, whatever speed its port is set to, and
/// no speed of the port is wrong.
const fn is_usb(model: &LidarModel) -> bool {
    matches!(model.firmware, Firmware::Hokuyo(_))
}

/// What can go wrong between this sensor and its host.
const fn possible(faults: LineFaults, model: &LidarModel) -> LineFaults {
    LineFaults { checks_speed: faults.checks_speed && !is_usb(model), ..faults }
}

/// A sensor with its plug.
#[derive(Debug)]
pub struct SerialLidar {
    model: LidarModel,
    device: Box<dyn Device>,
    uart: Uart,
    line: PtyLine,
    n_overrun: u64,
}

impl SerialLidar {
    /// A sensor that gets its power at `now`, or has had it for long if `is_running`.
    ///
    /// # Errors
    /// What the operating system says if it has no pseudo-terminal to give.
    pub fn open(
        model: &LidarModel,
        faults: LineFaults,
        seeds: SeedBook,
        now: Stamp<Mono>,
        is_running: bool,
    ) -> std::io::Result<Self> {
        Ok(Self {
            model: model.clone(),
            device: device(model, seeds, now, is_running),
            uart: Uart::new(if is_usb(model) { USB_SPEED } else { model.baud }),
            line: PtyLine::open(model.baud, possible(faults, model), seeds)?,
            n_overrun: 0,
        })
    }

    /// The device file to open as the serial port.
    #[must_use]
    pub fn path(&self) -> &Path {
        self.line.path()
    }

    /// What became of the samples so far.
    #[must_use]
    pub fn counts(&self) -> LineCounts {
        let counts = self.line.counts();
        LineCounts { samples_overrun: counts.samples_overrun + self.n_overrun, ..counts }
    }

    /// Something happens to the sensor.
    pub fn suffer(&mut self, mishap: Mishap, now: Stamp<Mono>) {
        self.device.suffer(mishap, now);
    }

    /// From now on the line has these faults.
    pub fn damage(&mut self, faults: LineFaults) {
        self.line.damage_by(possible(faults, &self.model));
    }

    /// A host says this to it, past the line: one that was there before.
    pub fn hear(&mut self, bytes: &[u8], now: Stamp<Mono>) {
        self.device.hear(bytes, now);
    }

    /// Goes on to `now`: hears the host, measures the scene, sends what has left the transmitter.
    ///
    /// # Errors
    /// What the operating system says of the line.
    pub fn advance(&mut self, now: Stamp<Mono>, scene: &mut dyn Scene) -> std::io::Result<()> {
        let heard = self.line.receive()?;
        if !heard.is_empty() {
            self.device.hear(&heard, now);
        }
        let mut frames = Vec::new();
        self.device.advance(now, scene, &mut frames);
        for frame in frames {
            self.n_overrun += self.uart.push(frame);
        }
        while let Some(frame) = self.uart.pop(now) {
            self.line.send(&frame.bytes, frame.n_samples)?;
        }
        Ok(())
    }
}
