//! Where the uncertainty of a volume comes from.

/// A source of error of a volume.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum BudgetSource {
    /// Surface that was thinly seen or not at all.
    Prior,
    /// Range and angle noise of the beams.
    BeamNoise,
    /// Roughness below a cell's size, which the nodes of the surface cannot show.
    Roughness,
    /// Hollows below a cell's size that grazing beams do not see: the share of what may hide there.
    Occlusion,
    /// Ground that no beam reached: what the rays over it leave open, and that it is off as a whole.
    HiddenGround,
    /// The vehicle's pose, correlated along the flight.
    Pose,
    /// How the LiDAR is bolted on: one constant error per axis of position and rotation.
    LidarMounting,
    /// A constant error of every range.
    RangeBias,
    /// An error of every range in proportion to it.
    RangeScale,
    /// A constant offset between the clocks of LiDAR and pose.
    ClockOffset,
    /// The surveyed places of the markers, and that of their map as a whole where its σ is given.
    MarkerMap,
    /// The base under the material.
    Base,
    /// The bulk density. It concerns tonnes only and is left out of the volume's variance.
    Density,
}

impl BudgetSource {
    /// Every source, in the order of a measurement's path.
    pub const ALL: [Self; 13] = [
        Self::Prior,
        Self::BeamNoise,
        Self::Roughness,
        Self::Occlusion,
        Self::HiddenGround,
        Self::Pose,
        Self::LidarMounting,
        Self::RangeBias,
        Self::RangeScale,
        Self::ClockOffset,
        Self::MarkerMap,
        Self::Base,
        Self::Density,
    ];

    /// A short stable name, for tables and JSON.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Prior => "prior",
            Self::BeamNoise => "beam_noise",
            Self::Roughness => "roughness",
            Self::Occlusion => "occlusion",
            Self::HiddenGround => "hidden_ground",
            Self::Pose => "pose",
            Self::LidarMounting => "lidar_mounting",
            Self::RangeBias => "range_bias",
            Self::RangeScale => "range_scale",
            Self::ClockOffset => "clock_offset",
            Self::MarkerMap => "marker_map",
            Self::Base => "base",
            Self::Density => "density",
        }
    }
}

/// One line of a budget: what one source adds to (σ^V)².
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BudgetRow {
    /// The source.
    pub source: BudgetSource,
    /// Its share of the volume's variance, m⁶; for the density V² (`σ_ρ`/ρ)², which is what it
    /// would be of a volume.
    pub var_m6: f64,
}

/// How a volume answers to one constant error that other surveys may share.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SharedSensitivity {
    /// The source the error belongs to.
    pub source: BudgetSource,
    /// Which of the source's errors this is, counted from 0; they are independent of each other.
    pub component: usize,
    /// ∂V/∂c, m³ per unit of the error (m, rad, s or 1, as the source has it).
    pub dv_dc: f64,
    /// Standard deviation of the error, in that unit.
    pub sigma: f64,
}

impl SharedSensitivity {
    /// What the error adds to the volume's variance, (∂V/∂c)² σ², m⁶.
    #[must_use]
    pub fn var_m6(&self) -> f64 {
        (self.dv_dc * self.sigma).powi(2)
    }
}

/// The variance of one volume by source.
///
/// `rows` holds every source once, those with constant errors included; `shared` itemises the
/// constant ones, so that they can cancel in the difference of two surveys.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct VolumeBudget {
    /// One row per source.
    pub rows: Vec<BudgetRow>,
    /// The constant errors behind the rows.
    pub shared: Vec<SharedSensitivity>,
}

impl VolumeBudget {
    /// (σ^V)², m⁶: all rows but the density.
    #[must_use]
    pub fn var_m6(&self) -> f64 {
        self.rows
            .iter()
            .filter(|row| row.source != BudgetSource::Density)
            .map(|row| row.var_m6)
            .sum()
    }

    /// What one source adds, m⁶.
    #[must_use]
    pub fn var_of_m6(&self, source: BudgetSource) -> f64 {
        self.rows.iter().filter(|row| row.source == source).map(|row| row.var_m6).sum()
    }

    /// What the constant errors of one source add, m⁶.
    #[must_use]
    pub fn shared_var_of_m6(&self, source: BudgetSource) -> f64 {
        self.shared
            .iter()
            .filter(|shared| shared.source == source)
            .map(SharedSensitivity::var_m6)
            .sum()
    }

    /// Adds a source whose errors are all constant: its row and its items.
    pub fn push_shared(&mut self, source: BudgetSource, items: &[(f64, f64)]) {
        let first = self.shared.len();
        self.shared.extend(items.iter().enumerate().map(|(component, &(dv_dc, sigma))| {
            SharedSensitivity { source, component, dv_dc, sigma }
        }));
        let var_m6 = self.shared[first..].iter().map(SharedSensitivity::var_m6).sum();
        self.rows.push(BudgetRow { source, var_m6 });
    }

    /// The rows, largest first; equal ones in the order of [`BudgetSource::ALL`].
    #[must_use]
    pub fn largest_first(&self) -> Vec<BudgetRow> {
        let mut rows = self.rows.clone();
        rows.sort_by(|a, b| b.var_m6.total_cmp(&a.var_m6).then(a.source.cmp(&b.source)));
        rows
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_add_up_without_the_density() {
        let mut budget = VolumeBudget::default();
        budget.rows.push(BudgetRow { source: BudgetSource::Prior, var_m6: 4.0 });
        budget.push_shared(BudgetSource::LidarMounting, &[(100.0, 0.01), (-50.0, 0.02)]);
        budget.rows.push(BudgetRow { source: BudgetSource::Density, var_m6: 9.0 });
        // 4 + (100 · 0.01)² + (50 · 0.02)² = 6
        assert!((budget.var_m6() - 6.0).abs() < 1e-12);
        assert!((budget.shared_var_of_m6(BudgetSource::LidarMounting) - 2.0).abs() < 1e-12);
        assert_eq!(budget.shared[1].component, 1);
        let order: Vec<_> = budget.largest_first().iter().map(|row| row.source).collect();
        assert_eq!(
            order,
            [BudgetSource::Density, BudgetSource::Prior, BudgetSource::LidarMounting]
        );
    }

    #[test]
    fn every_source_has_a_name_of_its_own() {
        let names: std::collections::BTreeSet<_> =
            BudgetSource::ALL.iter().map(|source| source.name()).collect();
        assert_eq!(names.len(), BudgetSource::ALL.len());
    }
}
