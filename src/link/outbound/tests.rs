//! Setpoints and poses against numbers computed by hand.
