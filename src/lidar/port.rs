//! Opens serial devices, with errors that say what to do.

use super::Settings;
use serialport::{ErrorKind, SerialPort, TTYPort};
use std::io;
use std::path::Path;
use std::time::Duration;

/// A read returns after this long even if nothing came.
pub(super) const READ_TIMEOUT: Duration = Duration::from_millis(50);

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
/// The modem lines are left alone: LDROBOT sensors do not use them, and pseudo-terminals have none.
pub(super) fn open(settings: &Settings) -> Result<TTYPort, OpenError> {
    let baud = settings.effective_baud();
    serialport::new(&settings.port, baud)
        .timeout(READ_TIMEOUT)
        .open_native()
        .map_err(|error| told(&error, &settings.port, baud))
        .inspect(drop_stale_input)
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
