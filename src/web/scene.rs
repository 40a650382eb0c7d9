//! What does not change during a flight: the hall as it is configured.

use crate::mapping::solid::Solid;
use crate::messages::GridGeometry;
use crate::pilot;
use serde::Serialize;
use utoipa::ToSchema;

/// The hall as it is configured; hall axes, m, z up.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
pub struct Scene {
    /// Smallest x and y, largest x and y of the region of interest, m.
    pub region_m: [f64; 4],
    /// Outlines of the bays.
    pub bays: Vec<Outline>,
    /// What stands in the region and is not measured.
    pub exclusions: Vec<[f64; 4]>,
    /// Inner faces of the walls as corners x and y, m; empty where none are configured.
    pub walls_m: Vec<[f64; 2]>,
    /// Lower face of the ceiling, m.
    pub ceiling_m: Option<f64>,
    /// What the vehicle must not touch.
    pub obstacles: Vec<Obstacle>,
    /// Where the vehicle may be at most, as corners x and y, m; empty for no limit.
    pub fence_m: Vec<[f64; 2]>,
    /// Lowest and highest place of the vehicle, m.
    pub fence_heights_m: Option<[f64; 2]>,
    /// Middles of the tags: x, y, z, m.
    pub tags_m: Vec<[f64; 3]>,
    /// Height of the flight, m.
    pub flight_height_m: f64,
    /// Heading of the survey, rad.
    pub survey_yaw_rad: f64,
    /// A fix is good enough above this quality, 1/√(m² + rad²).
    pub min_fix_quality: f64,
    /// Largest speed, m/s.
    pub max_speed_mps: f64,
    /// The survey ends once σ of the volume is this share of it, 0 to 1; left out: it flies all.
    pub target_sigma_ratio: Option<f64>,
    /// The cells of the map.
    #[serde(skip)]
    #[schema(ignore)]
    pub(super) grid: GridGeometry,
}

/// A polygon with a name.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
pub struct Outline {
    /// Whose.
    pub name: String,
    /// Corners x and y, m.
    pub corners_m: Vec<[f64; 2]>,
}

/// An upright prism, or the box around a mesh.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
pub struct Obstacle {
    /// Corners x and y of its footprint, m.
    pub corners_m: Vec<[f64; 2]>,
    /// Lowest and highest point, m.
    pub heights_m: [f64; 2],
}

impl Scene {
    /// The hall of a brain.
    #[must_use]
    pub fn new(settings: &pilot::Settings) -> Self {
        let (mapping, planning) = (&settings.mapping, &settings.planning);
        let (region, space) = (&mapping.region, &planning.space);
        let b = &region.bounds;
        let corners = |corners: &[(f64, f64)]| corners.iter().map(|(x, y)| [*x, *y]).collect();
        let fence = space.fence.as_ref();
        let bay = |bay: &crate::mapping::bay::Bay| Outline {
            name: bay.name.clone(),
            corners_m: corners(bay.outline.corners_m()),
        };
        let tags = settings.localization.marker_map.iter();
        Self {
            region_m: [b.x_min_m, b.y_min_m, b.x_max_m, b.y_max_m],
            bays: region.bays.iter().map(bay).collect(),
            exclusions: region.exclusions.iter().map(bounds_of).collect(),
            walls_m: space.walls.as_ref().map_or_else(Vec::new, |w| corners(w.corners_m())),
            ceiling_m: space.ceiling_m,
            obstacles: space.obstacles.iter().map(Obstacle::new).collect(),
            fence_m: fence
                .and_then(|fence| fence.outline.as_ref())
                .map_or_else(Vec::new, |outline| corners(outline.corners_m())),
            fence_heights_m: fence.map(|fence| [fence.min_height_m, fence.max_height_m]),
            tags_m: tags
                .map(|(_, _, corners)| {
                    let sum = corners.iter().fold([0.0; 3], |sum, corner| {
                        let p = corner.coords;
                        [sum[0] + p.x, sum[1] + p.y, sum[2] + p.z]
                    });
                    sum.map(|of_four| of_four / 4.0)
                })
                .collect(),
            flight_height_m: planning.height_m,
            survey_yaw_rad: planning.yaw_rad,
            min_fix_quality: planning.min_fix_quality,
            max_speed_mps: planning.limits.speed_mps,
            target_sigma_ratio: planning.target_ratio,
            grid: region.grid(mapping.cell_m),
        }
    }
}

fn bounds_of(footprint: &crate::mapping::region::Footprint) -> [f64; 4] {
    use crate::mapping::region::Footprint;
    let rect = match footprint {
        Footprint::Rect(rect) => rect,
        Footprint::Polygon(polygon) => polygon.bounds(),
    };
    [rect.x_min_m, rect.y_min_m, rect.x_max_m, rect.y_max_m]
}

impl Obstacle {
    fn new(solid: &Solid) -> Self {
        let bounds = solid.bounds();
        let (low, high) = (bounds.min_m, bounds.max_m);
        let corners_m = match solid {
            Solid::Prism(prism) => {
                prism.footprint().corners_m().iter().map(|(x, y)| [*x, *y]).collect()
            }
            Solid::Mesh(_) => {
                vec![[low.x, low.y], [high.x, low.y], [high.x, high.y], [low.x, high.y]]
            }
        };
        Self { corners_m, heights_m: [low.z, high.z] }
    }
}
