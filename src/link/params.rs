//! Parameters over MAVLink: those of the autopilot, read and written, and the few of this service.
//!
//! A parameter travels in a float field, whatever its type, and autopilots differ in how: PX4 puts
//! the bits of an INT32 there, ArduPilot its value as a float. Read the wrong way, 1 becomes
//! 1065353216 or 1.4e-45, and a read-back looks right. So every value here has a type, and the
//! encoding follows the autopilot that speaks.

mod comparison;
mod exchange;
mod file;
mod live;
mod server;
mod value;

pub use comparison::{Comparison, Problem, compare, compare_demand};
pub use exchange::{Exchange, Outcome};
pub use file::{Demand, FileError, Line, ParamFile};
pub use live::{LiveAutopilot, LiveError};
pub(crate) use server::ParamServer;
pub use server::Published;
pub use value::{Encoding, Kind, Value};
