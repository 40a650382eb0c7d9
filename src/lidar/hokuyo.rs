//! Hokuyo sensors (URG-04LX, UTM-30LX) by SCIP 2.0: lines of text.
//!
//! ```text
//! request:  MD0044072500000 LF                     start, end, cluster, skip, count
//! reply:    echo LF  status sum LF  time sum LF  data … sum LF  … LF
//! ```
//! Numbers are written with six bits a character above `0`, most significant first; a data line
//! holds 64 characters, and a number may straddle two of them. The sum behind each line is the low
//! six bits of the sum of its bytes, above `0` again. A reply ends with an empty line.
//!
//! Six bits of sum let one damaged line in 64 pass, so a block counts only if all its lines have
//! the right sums and lengths and together hold as many numbers as were asked for.
//!
//! Source: Hokuyo's SCIP 2.0 specification by way of `urg_library` 1.2.7 (`urg_sensor.c`).

mod block;
mod session;
mod text;

pub use block::{Block, BlockReader};
pub use session::Hokuyo;
pub(super) use session::model_of;
pub use text::{number, sum_of};
