//! Maps for displays: scaled down, rounded, encoded once for everybody.

use super::earlier::Earlier;
use super::scene::Scene;
use super::state::MapVersions;
use crate::geometry::Point;
use crate::messages::{CellCoverage, GridGeometry, HeightMap};
use crate::planning::Waypoint;
use crate::planning::free_space::FreeSpace;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::sync::Arc;
use utoipa::ToSchema;

/// A display has no use for more cells along a side.
const MOST_CELLS: usize = 160;
/// Millimetres are enough for eyes.
const STEPS_PER_M: f64 = 1e3;
/// Places of the map of the fix quality are this far apart at least, m.
const QUALITY_CELL_M: f64 = 0.5;

/// Which map.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "kebab-case")]
pub(super) enum MapKind {
    /// Height of the surface over the hall's zero, m.
    Height,
    /// Its 1-σ, m.
    Sigma,
    /// 0 measured, 1 interpolated, 2 never seen, 3 disturbed.
    Coverage,
    /// Quality of a fix at the height of the flight, 1/√(m² + rad²).
    FixQuality,
    /// Height against the last survey or the surveyed floor, m; nothing where either has not been seen.
    Change,
}

/// A map; row 0 is at the smallest y.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
pub(super) struct Map {
    /// Which.
    pub(super) kind: MapKind,
    /// What a change is held against.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) against: Option<String>,
    /// Unit of the values.
    pub(super) unit: &'static str,
    /// Counts the maps of this kind.
    pub(super) version: u64,
    /// Outer corner of the first cell, m.
    pub(super) x_min_m: f64,
    /// Outer corner of the first cell, m.
    pub(super) y_min_m: f64,
    /// Edge of a cell, m.
    pub(super) cell_m: f64,
    /// Cells along x.
    pub(super) n_cols: usize,
    /// Cells along y.
    pub(super) n_rows: usize,
    /// Cells of the measured map along each side of one of these.
    pub(super) scaled_by: usize,
    /// The values by rows; `null` where there is none.
    pub(super) values: Vec<Option<f64>>,
}

/// The newest surfaces, and what was encoded of them.
#[derive(Debug, Default)]
pub(super) struct Maps {
    surface: Option<Box<HeightMap>>,
    coverage: Vec<CellCoverage>,
    earlier: Option<Earlier>,
    versions: MapVersions,
    space: Option<Arc<FreeSpace>>,
    encoded: BTreeMap<MapKind, (u64, Arc<str>)>,
}

impl Maps {
    pub(super) fn new(space: Arc<FreeSpace>, earlier: Option<Earlier>) -> Self {
        let versions = MapVersions { fix_quality: 1, ..MapVersions::default() };
        Self { space: Some(space), earlier, versions, ..Self::default() }
    }

    /// The change is held against this from now on.
    pub(super) fn compare_with(&mut self, earlier: Earlier) {
        self.versions.change += u64::from(self.surface.is_some());
        self.earlier = Some(earlier);
    }

    pub(super) const fn versions(&self) -> MapVersions {
        self.versions
    }

    /// The next flight measures anew.
    pub(super) fn restart(&mut self) {
        self.surface = None;
        self.coverage.clear();
        self.versions =
            MapVersions { fix_quality: self.versions.fix_quality, ..MapVersions::default() };
        self.encoded.retain(|kind, _| *kind == MapKind::FixQuality);
    }

    /// How the cells of the surface that follows are known.
    pub(super) fn cover(&mut self, coverage: Vec<CellCoverage>) {
        self.coverage = coverage;
    }

    pub(super) fn surface(&mut self, surface: Box<HeightMap>) {
        self.versions.height += 1;
        self.versions.sigma += 1;
        self.versions.coverage += u64::from(!self.coverage.is_empty());
        self.versions.change += u64::from(self.fits_earlier(&surface));
        self.surface = Some(surface);
    }

    fn fits_earlier(&self, surface: &HeightMap) -> bool {
        let n_cells = surface.grid.n_cells();
        self.earlier.as_ref().is_some_and(|earlier| earlier.heights_m.len() == n_cells)
    }

    /// Height now against before, where both are known.
    fn change<'a>(
        &'a self,
        surface: &'a HeightMap,
    ) -> impl Fn(&mut dyn Iterator<Item = usize>) -> Option<f64> + 'a {
        mean_of(move |cell| {
            // What nobody has seen yet is the prior's guess, and its change none of the material's.
            let is_unseen = self.coverage.get(cell) == Some(&CellCoverage::Unseen);
            let before_m = self.earlier.as_ref()?.heights_m[cell].filter(|_| !is_unseen)?;
            Some(surface.mean_m[cell] - before_m)
        })
    }

    /// The encoded map; `None` while there is none.
    pub(super) fn encoded(&mut self, kind: MapKind, scene: &Scene) -> Option<Arc<str>> {
        let version = self.version(kind);
        if let Some((known, text)) = self.encoded.get(&kind)
            && *known == version
        {
            return Some(Arc::clone(text));
        }
        let map = self.map(kind, scene)?;
        let text: Arc<str> = serde_json::to_string(&map).ok()?.into();
        self.encoded.insert(kind, (version, Arc::clone(&text)));
        Some(text)
    }

    const fn version(&self, kind: MapKind) -> u64 {
        let MapVersions { height, sigma, coverage, fix_quality, change } = self.versions;
        match kind {
            MapKind::Height => height,
            MapKind::Sigma => sigma,
            MapKind::Coverage => coverage,
            MapKind::FixQuality => fix_quality,
            MapKind::Change => change,
        }
    }

    fn map(&self, kind: MapKind, scene: &Scene) -> Option<Map> {
        let (version, unit) = (self.version(kind), "m");
        if kind == MapKind::FixQuality {
            return Some(fix_quality(self.space.as_ref()?, scene, version));
        }
        let surface = self.surface.as_ref()?;
        let grid = &surface.grid;
        let mean = |values: Vec<f64>| scaled(grid, mean_of(move |cell| Some(values[cell])));
        let (unit, (grid, scaled_by, values)) = match kind {
            MapKind::Height => (unit, mean(surface.mean_m.clone())),
            MapKind::Sigma => (unit, mean(surface.sigma_m.clone())),
            MapKind::Coverage if self.coverage.len() == grid.n_cells() => {
                // The worst of the cells: no gap may vanish by scaling.
                let worst = |cells: &mut dyn Iterator<Item = usize>| {
                    cells.map(|cell| self.coverage[cell]).max().map(|c| f64::from(c as u8))
                };
                ("", scaled(grid, worst))
            }
            MapKind::Change if self.fits_earlier(surface) => {
                (unit, scaled(grid, self.change(surface)))
            }
            MapKind::Coverage | MapKind::Change | MapKind::FixQuality => return None,
        };
        let against = self.earlier.as_ref().filter(|_| kind == MapKind::Change);
        Some(Map {
            kind,
            against: against.map(|earlier| earlier.name.clone()),
            unit,
            version,
            x_min_m: grid.x_min_m,
            y_min_m: grid.y_min_m,
            cell_m: grid.cell_m,
            n_cols: grid.n_cols,
            n_rows: grid.n_rows,
            scaled_by,
            values,
        })
    }
}

/// The mean of those cells that have a value, to the millimetre.
fn mean_of(
    value: impl Fn(usize) -> Option<f64>,
) -> impl Fn(&mut dyn Iterator<Item = usize>) -> Option<f64> {
    move |cells| {
        let known = cells.filter_map(&value);
        let (sum, n) = known.fold((0.0, 0.0), |(sum, n), value| (sum + value, n + 1.0));
        // A division, since a product with 0.001 has digits behind the millimetres.
        (n > 0.0).then(|| (sum / n * STEPS_PER_M).round() / STEPS_PER_M)
    }
}

/// A coarser grid, how many cells became one along each side, and the values.
fn scaled(
    grid: &GridGeometry,
    value: impl Fn(&mut dyn Iterator<Item = usize>) -> Option<f64>,
) -> (GridGeometry, usize, Vec<Option<f64>>) {
    let by = grid.n_cols.max(grid.n_rows).div_ceil(MOST_CELLS).max(1);
    let (n_cols, n_rows) = (grid.n_cols.div_ceil(by), grid.n_rows.div_ceil(by));
    #[expect(clippy::cast_precision_loss, reason = "few cells")]
    let cell_m = grid.cell_m * by as f64;
    let coarse = GridGeometry { cell_m, n_cols, n_rows, ..*grid };
    let values = (0..coarse.n_cells()).map(|cell| {
        let (row, col) = (cell / n_cols * by, cell % n_cols * by);
        let cols = move || col..(col + by).min(grid.n_cols);
        let rows = row..(row + by).min(grid.n_rows);
        value(&mut rows.flat_map(move |row| cols().map(move |col| grid.index(col, row))))
    });
    (coarse, by, values.collect())
}

/// Quality of a fix over the region, without touching what the brain uses.
fn fix_quality(space: &FreeSpace, scene: &Scene, version: u64) -> Map {
    let [x_min_m, y_min_m, x_max_m, y_max_m] = scene.region_m;
    let longest_m = (x_max_m - x_min_m).max(y_max_m - y_min_m);
    #[expect(clippy::cast_precision_loss, reason = "a small constant")]
    let cell_m = (longest_m / (MOST_CELLS / 2) as f64).max(QUALITY_CELL_M);
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "few cells")]
    let count = |extent_m: f64| (extent_m / cell_m - 1e-9).ceil().max(1.0) as usize;
    let (n_cols, n_rows) = (count(x_max_m - x_min_m), count(y_max_m - y_min_m));
    let grid = GridGeometry { x_min_m, y_min_m, cell_m, n_cols, n_rows };
    let sensing = space.quality().sensing();
    let quality = |cell| {
        let (x, y) = grid.centre_m(cell);
        let place = Point::new(x, y, scene.flight_height_m);
        let waypoint = Waypoint { place, yaw_rad: scene.survey_yaw_rad };
        if !space.clearance().is_clear(&place.coords) {
            return None;
        }
        let cov = sensing.fix_cov(&waypoint.level_pose());
        Some(cov.map_or(0.0, |cov| (10.0 / cov.trace().sqrt()).round() / 10.0))
    };
    let values = (0..grid.n_cells()).map(quality).collect();
    Map {
        kind: MapKind::FixQuality,
        against: None,
        unit: "1/√(m² + rad²)",
        version,
        x_min_m,
        y_min_m,
        cell_m,
        n_cols,
        n_rows,
        scaled_by: 1,
        values,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::time::Stamp;

    fn surface(n_cols: usize, n_rows: usize) -> Box<HeightMap> {
        let grid = GridGeometry { x_min_m: 1.0, y_min_m: 2.0, cell_m: 0.1, n_cols, n_rows };
        #[expect(clippy::cast_precision_loss, reason = "few cells")]
        let mean_m = (0..grid.n_cells()).map(|cell| cell as f64).collect();
        let sigma_m = vec![0.0126; grid.n_cells()];
        Box::new(HeightMap { at: Stamp::ZERO, grid, mean_m, sigma_m, disturbed_cells: Vec::new() })
    }

    #[test]
    fn large_maps_are_scaled_by_means_and_gaps_stay() {
        // 321 cells need blocks of 3: 107 × 1, the last row of two cells' height alone.
        let surface = surface(321, 2);
        let (grid, by, values) = scaled(&surface.grid, |cells| {
            let found: Vec<usize> = cells.collect();
            #[expect(clippy::cast_precision_loss, reason = "few cells")]
            let mean = found.iter().sum::<usize>() as f64 / found.len() as f64;
            Some(mean)
        });
        assert_eq!((grid.n_cols, grid.n_rows, by), (107, 1, 3));
        assert!((grid.cell_m - 0.3).abs() < 1e-12);
        // Cells 0, 1, 2 and 321, 322, 323.
        assert_eq!(values[0], Some(161.5));
        let mut maps = Maps { coverage: vec![CellCoverage::Measured; 642], ..Maps::default() };
        maps.coverage[323] = CellCoverage::Unseen;
        maps.surface(surface);
        let covered = maps.map(MapKind::Coverage, &scene()).unwrap();
        assert_eq!(covered.values[..2], [Some(2.0), Some(0.0)]);
        let sigma = maps.map(MapKind::Sigma, &scene()).unwrap();
        assert_eq!(sigma.values[5], Some(0.013));
        assert!(maps.map(MapKind::Change, &scene()).is_none(), "no earlier survey");
    }

    #[test]
    fn the_change_leaves_out_what_either_survey_has_not_seen() {
        let heights_m = vec![Some(0.5), None, Some(1.0), Some(1.0), Some(0.0), Some(7.25)];
        let earlier = Earlier { name: "survey of 2026-01-02".to_owned(), heights_m };
        let mut maps = Maps::default();
        maps.surface(surface(3, 2));
        assert_eq!(maps.versions().change, 0);
        // It may come later than the first surface: reading it takes time.
        maps.compare_with(earlier);
        assert_eq!(maps.versions().change, 1);
        let mut coverage = vec![CellCoverage::Measured; 6];
        coverage[3] = CellCoverage::Unseen;
        coverage[4] = CellCoverage::Disturbed;
        maps.cover(coverage);
        maps.surface(surface(3, 2));
        let change = maps.map(MapKind::Change, &scene()).unwrap();
        // Heights are 0, 1, 2, 3, 4, 5 m now.
        let expected = [Some(-0.5), None, Some(1.0), None, Some(4.0), Some(-2.25)];
        assert_eq!(change.values, expected);
        assert_eq!((change.version, change.against.as_deref()), (2, Some("survey of 2026-01-02")));
        assert_eq!(maps.map(MapKind::Height, &scene()).unwrap().against, None);
        // Another hall's.
        maps.surface(surface(4, 4));
        assert!(maps.map(MapKind::Change, &scene()).is_none());
    }

    #[test]
    fn a_map_is_encoded_once_and_anew_after_the_next_surface() {
        let mut maps = Maps::default();
        assert!(maps.encoded(MapKind::Height, &scene()).is_none());
        maps.surface(surface(3, 3));
        let first = maps.encoded(MapKind::Height, &scene()).unwrap();
        assert!(Arc::ptr_eq(&first, &maps.encoded(MapKind::Height, &scene()).unwrap()));
        maps.surface(surface(3, 3));
        let second = maps.encoded(MapKind::Height, &scene()).unwrap();
        assert!(!Arc::ptr_eq(&first, &second));
        let value: serde_json::Value = serde_json::from_str(&second).unwrap();
        assert_eq!((value["version"].as_u64(), value["n_cols"].as_u64()), (Some(2), Some(3)));
        maps.restart();
        assert!(maps.encoded(MapKind::Height, &scene()).is_none());
    }

    fn scene() -> Scene {
        crate::web::collector::tests::scene()
    }
}
