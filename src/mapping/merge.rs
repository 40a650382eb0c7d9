//! Maps of several flights, vehicles or cut-off logs as one.
//!
//! A map of the field is the list of its turns, so merged maps are the joined lists: one solve over
//! all of them, with the slopes of the joint surface. The result *is* the joint solution, not a sum of
//! solutions that were linearised apart.
//!
//! ```text
//! flight A: turns ─┐
//! flight B: turns ─┼─▶ one map ─▶ Q = Q0 + Σ_A aaᵀ/R + Σ_B aaᵀ/R ─▶ h, q ─▶ V, budget
//! flight C: turns ─┘
//! ```
//!
//! - Errors of the pose are independent between flights: nothing of the filter's error at the end of
//!   one lives on in the next.
//! - Errors of the LiDAR (mounting, range bias and scale, clock) are constant for a vehicle and
//!   independent between vehicles.
//! - Errors of the marker map and of the base are common to all.
//!
//! Material must stand still between the flights. Where it did not, the rules of
//! [`disturbance`](super::disturbance) hold.
//! Checked: `tests`; through logs by `tests/merge` of the simulator.

use super::footprint::Footprint;
use super::mapper::{Mapper, Method, Settings};
use super::projection::LidarMount;
use nalgebra::SMatrix;
use std::sync::Arc;

/// The turns of one flight.
#[derive(Debug, Clone)]
pub struct FlightTurns<'a> {
    /// What it was flown with.
    pub settings: &'a Settings,
    /// Number of its vehicle, from 0 without gaps in the order of the flights.
    pub vehicle_idx: usize,
    /// Its turns, in their order.
    pub turns: &'a [Arc<Footprint>],
}

/// Why flights have no common map.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum MergeError {
    /// There is none.
    #[error("there is no flight to merge")]
    NoFlight,
    /// The paper's grid does not add up.
    #[error(
        "maps of surface.method = \"kalman-grid\" do not add up: \
         each cell holds an error that all flights share; use matern-field"
    )]
    Method,
    /// The flights do not measure the same.
    #[error("flight {flight} has another {what} than the first: they have no common map")]
    Different {
        /// Which flight, from 0.
        flight: usize,
        /// What differs.
        what: &'static str,
    },
    /// The LiDAR is not that of the vehicle, or numbers are left out.
    #[error("flight {flight} is not of the vehicle that it names: its LiDAR is another")]
    Vehicle {
        /// Which flight, from 0.
        flight: usize,
    },
}

/// One map of all flights, in their order.
///
/// # Errors
/// [`MergeError`] names the first flight that does not fit.
pub fn merged(flights: &[FlightTurns<'_>]) -> Result<Mapper, MergeError> {
    let first = flights.first().ok_or(MergeError::NoFlight)?;
    if first.settings.method != Method::MaternField {
        return Err(MergeError::Method);
    }
    let mut lidars: Vec<LidarMount> = Vec::new();
    for (index, flight) in flights.iter().enumerate() {
        if let Some(what) = difference(first.settings, flight.settings) {
            return Err(MergeError::Different { flight: index, what });
        }
        let lidar = &flight.settings.lidar;
        match lidars.get(flight.vehicle_idx) {
            Some(known) if known == lidar => {}
            None if flight.vehicle_idx == lidars.len() => lidars.push(lidar.clone()),
            _ => return Err(MergeError::Vehicle { flight: index }),
        }
    }
    let mut mapper = Mapper::new(first.settings.clone());
    if let Some(field) = mapper.field_mut() {
        field.set_lidars(lidars);
        for flight in flights {
            for (turn, footprint) in flight.turns.iter().enumerate() {
                field.push(of_vehicle(footprint, flight.vehicle_idx, turn == 0));
            }
        }
    }
    Ok(mapper)
}

/// What two flights must have in common and have not.
fn difference(a: &Settings, b: &Settings) -> Option<&'static str> {
    let pairs = [
        (a.method == b.method, "surface method"),
        (a.region.bounds == b.region.bounds, "region"),
        (a.region.bays == b.region.bays, "set of bays"),
        (
            a.region.exclusions == b.region.exclusions
                && same(a.region.exclusion_margin_m, b.region.exclusion_margin_m),
            "set of exclusions",
        ),
        (same(a.cell_m, b.cell_m), "cell size"),
        (same(a.base_height_m, b.base_height_m), "base height"),
        (a.field.calibration == b.field.calibration, "surface.uncertainty"),
        (a.field == b.field, "surface.field"),
    ];
    pairs.into_iter().find(|(is_same, _)| !is_same).map(|(_, what)| what)
}

/// Equal as they were written down.
const fn same(a: f64, b: f64) -> bool {
    a.to_bits() == b.to_bits()
}

/// A turn among those of other flights.
fn of_vehicle(turn: &Arc<Footprint>, lidar_idx: usize, is_first: bool) -> Footprint {
    let mut turn = Footprint::clone(turn);
    turn.lidar_idx = lidar_idx;
    if is_first {
        // Whatever came before it was another flight.
        turn.error.from_previous = SMatrix::zeros();
    }
    turn
}

#[cfg(test)]
mod tests;
