//! Opens serial devices, with errors that say what to do.

use super::Request;
use serialport::{ErrorKind, SerialPort, TTYPort};
use std::io::{self, Write};
use std::path::Path;
use std::time::Duration;

/// A read returns after this long even if nothing came.
pub(super) const READ_TIMEOUT: Duration = Duration::from_millis(50);

/// A latency timer up to this blurs no stamps, ms.
pub const GOOD_LATENCY_MS: u32 = 1;

/// Why a serial port could not be opened.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum OpenError {
    /// There is no such device.
    #[error(
        "serial port {port} does not exist; is the lidar plugged in? `ls -l /dev/serial/by-path` \
         lists what is"
    )]
    Missing {
        /// The device.
        port: String,
    },
    /// This user may not open it.
    #[error(
        "no permission to open serial port {port}; add the user to the group of the device \
         (`ls -l {port}`; often `sudo usermod -aG dialout $USER`, then log in again)"
    )]
    Permission {
        /// The device.
        port: String,
    },
    /// Another program holds it.
    #[error("serial port {port} is in use by another program; `fuser -v {port}` names it")]
    Busy {
        /// The device.
        port: String,
    },
    /// The device does not take the line settings, or is no serial device.
    #[error("serial port {port} cannot be used at {baud} baud: {cause}")]
    Unusable {
        /// The device.
        port: String,
        /// The line speed asked for, bit/s.
        baud: u32,
        /// What the system said.
        cause: String,
    },
}

/// Opens the port for this process alone: 8 data bits, no parity, 1 stop bit, no flow control.
///
/// The modem lines stay as the system sets them; sensors that care are asked to change them.
pub(super) fn open(port: &str, baud: u32) -> Result<TTYPort, OpenError> {
    serialport::new(port, baud)
        .timeout(READ_TIMEOUT)
        .open_native()
        .map_err(|error| told(&error, port, baud))
        .inspect(drop_stale_input)
}

/// Does what a sensor asks for on the line.
///
/// # Errors
/// A line that does not take bytes any more.
pub(super) fn fulfil(port: &mut TTYPort, request: &Request) -> io::Result<()> {
    match request {
        Request::Send(bytes) => port.write_all(bytes),
        Request::SetDtr(level) => {
            // Pseudo-terminals and some adapters have no modem lines: nothing to switch then.
            if let Err(error) = port.write_data_terminal_ready(*level) {
                tracing::debug!(%error, "the serial port has no DTR");
            }
            Ok(())
        }
    }
}

/// How long the adapter behind a port may hold bytes back, ms; `None` if it has no such timer.
///
/// FTDI adapters have one, of 16 ms by default, which blurs the stamps of the beams.
#[must_use]
pub fn latency_timer_ms(port: &Path) -> Option<u32> {
    let device = std::fs::canonicalize(port).ok()?;
    let driver = Path::new("/sys/bus/usb-serial/devices").join(device.file_name()?);
    std::fs::read_to_string(driver.join("latency_timer")).ok()?.trim().parse().ok()
}

/// Warns of an adapter that holds bytes back.
pub(super) fn warn_of_latency(port: &str) {
    if let Some(ms) = latency_timer_ms(Path::new(port)).filter(|ms| *ms > GOOD_LATENCY_MS) {
        tracing::warn!(
            port,
            latency_timer_ms = ms,
            "the lidar's adapter holds bytes back; set its latency timer to 1 ms with \
             deploy/99-stockpilot.rules"
        );
    }
}

/// What the kernel kept from before cannot be stamped.
fn drop_stale_input(port: &TTYPort) {
    if let Err(error) = port.clear(serialport::ClearBuffer::Input) {
        tracing::debug!(%error, "cannot clear the input of the serial port");
    }
}

fn told(error: &serialport::Error, port: &str, baud: u32) -> OpenError {
    let port = port.to_owned();
    match error.kind() {
        ErrorKind::Io(io::ErrorKind::PermissionDenied) => OpenError::Permission { port },
        // The same kind stands for "no such device" and "locked by another".
        ErrorKind::NoDevice if Path::new(&port).exists() => OpenError::Busy { port },
        ErrorKind::NoDevice | ErrorKind::Io(io::ErrorKind::NotFound) => OpenError::Missing { port },
        _ => OpenError::Unusable { port, baud, cause: error.to_string() },
    }
}
