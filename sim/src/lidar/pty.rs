//! A serial line without hardware: the master side of a pseudo-terminal.

use rustix::fs::{OFlags, fcntl_getfl, fcntl_setfl};
use rustix::io::{Errno, read, write};
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use rustix::termios::{OptionalActions, tcgetattr, tcsetattr};
use std::os::fd::OwnedFd;
use std::path::{Path, PathBuf};
use stockpilot::stats::{Noise, SeedBook};

/// The speed of a line that nobody has opened and set up yet, bit/s.
const UNOPENED_BAUD: u32 = 50;

/// What goes wrong on the line on purpose.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct LineFaults {
    /// Share of bytes that arrive with one bit flipped.
    pub corrupt_byte_ratio: f64,
    /// Share of frames of which only a part arrives.
    pub half_frame_ratio: f64,
    /// A reader with another speed than the sensor's gets garbage, as on a real line.
    pub checks_speed: bool,
}

/// What became of the samples; the four add up to all samples handed in.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct LineCounts {
    /// Left whole.
    pub samples_sent: u64,
    /// Lost because the reader was too slow and the line's buffer full.
    pub samples_overrun: u64,
    /// Left damaged, by a flipped bit or a wrong speed.
    pub samples_corrupted: u64,
    /// Measured before anybody opened the line.
    pub samples_unheard: u64,
}

/// A sensor's end of a pseudo-terminal.
///
/// Both ends are raw. A slave descriptor stays open, so the line survives its reader. Nothing
/// blocks: bytes that do not fit are lost, as in a full UART buffer. Linux takes 20 480 bytes
/// before that.
#[derive(Debug)]
pub struct PtyLine {
    master: OwnedFd,
    slave: OwnedFd,
    path: PathBuf,
    baud: u32,
    faults: LineFaults,
    noise: Noise,
    counts: LineCounts,
}

impl PtyLine {
    /// A line for a sensor of this speed (bit/s).
    ///
    /// # Errors
    /// What the operating system says if it has no pseudo-terminal to give.
    pub fn open(baud: u32, faults: LineFaults, seeds: SeedBook) -> std::io::Result<Self> {
        let master = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC)?;
        grantpt(&master)?;
        unlockpt(&master)?;
        let name = ptsname(&master, Vec::new())?.into_string().map_err(std::io::Error::other)?;
        let path = PathBuf::from(name);
        let flags = OFlags::RDWR | OFlags::NOCTTY | OFlags::CLOEXEC;
        let slave = rustix::fs::open(&path, flags, rustix::fs::Mode::empty())?;
        make_raw(&master)?;
        make_raw(&slave)?;
        fcntl_setfl(&master, fcntl_getfl(&master)? | OFlags::NONBLOCK)?;
        let noise = seeds.stream("fault.lidar_line");
        Ok(Self { master, slave, path, baud, faults, noise, counts: LineCounts::default() })
    }

    /// The device file to open as the serial port.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// What became of the samples so far.
    #[must_use]
    pub fn counts(&self) -> LineCounts {
        self.counts
    }

    /// From now on these things go wrong.
    pub const fn damage_by(&mut self, faults: LineFaults) {
        self.faults = faults;
    }

    /// The speed that the reader has set, bit/s.
    ///
    /// # Errors
    /// What the operating system says.
    pub fn reader_baud(&self) -> std::io::Result<u32> {
        Ok(tcgetattr(&self.slave)?.output_speed())
    }

    /// Puts a frame with so many samples on the line.
    ///
    /// # Errors
    /// Anything but a full buffer.
    pub fn send(&mut self, frame: &[u8], n_samples: u64) -> std::io::Result<()> {
        let reader_baud = self.reader_baud()?;
        if reader_baud == UNOPENED_BAUD {
            self.counts.samples_unheard += n_samples;
            return Ok(());
        }
        let mut bytes = frame.to_vec();
        let is_garbled = self.faults.checks_speed && reader_baud != self.baud;
        let is_damaged = if is_garbled { self.garble(&mut bytes) } else { self.damage(&mut bytes) };
        match write(&self.master, &bytes) {
            Ok(n) if n == bytes.len() && is_damaged => self.counts.samples_corrupted += n_samples,
            Ok(n) if n == bytes.len() => self.counts.samples_sent += n_samples,
            Ok(_) | Err(Errno::AGAIN) => self.counts.samples_overrun += n_samples,
            Err(error) => return Err(error.into()),
        }
        Ok(())
    }

    /// What the reader has sent; nothing that makes sense at another speed.
    ///
    /// # Errors
    /// What the operating system says.
    pub fn receive(&mut self) -> std::io::Result<Vec<u8>> {
        let mut bytes = Vec::new();
        let mut chunk = [0; 256];
        loop {
            match read(&self.master, &mut chunk) {
                Ok(0) | Err(Errno::AGAIN) => break,
                Ok(n) => bytes.extend_from_slice(&chunk[..n]),
                Err(error) => return Err(error.into()),
            }
        }
        if self.faults.checks_speed && !bytes.is_empty() && self.reader_baud()? != self.baud {
            self.garble(&mut bytes);
        }
        Ok(bytes)
    }

    /// Flips bits and cuts frames at the configured rates; true if anything was done.
    fn damage(&mut self, frame: &mut Vec<u8>) -> bool {
        let mut is_damaged = false;
        if self.faults.corrupt_byte_ratio > 0.0 {
            for byte in frame.iter_mut() {
                if self.noise.chance(self.faults.corrupt_byte_ratio) {
                    *byte ^= 1 << (self.noise.bits() % 8);
                    is_damaged = true;
                }
            }
        }
        if self.faults.half_frame_ratio > 0.0 && self.noise.chance(self.faults.half_frame_ratio) {
            frame.truncate(frame.len() / 2);
            is_damaged = true;
        }
        is_damaged
    }

    /// What a reader with the wrong speed sees.
    fn garble(&mut self, frame: &mut [u8]) -> bool {
        for byte in frame {
            *byte = self.noise.bits().to_le_bytes()[0];
        }
        true
    }
}

/// Bytes pass unchanged; the speed is one that no reader would choose.
fn make_raw(terminal: &OwnedFd) -> std::io::Result<()> {
    let mut settings = tcgetattr(terminal)?;
    settings.make_raw();
    settings.set_speed(UNOPENED_BAUD)?;
    tcsetattr(terminal, OptionalActions::Now, &settings)?;
    Ok(())
}
