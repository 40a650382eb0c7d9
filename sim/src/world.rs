//! The true hall: material, walls, markers and pad.
//!
//! Everything solid is one of five things: the hall's box (floor, walls, ceiling; it may have
//! openings), the material ([`HeightField`], standing on the floor), the walls of the bays
//! ([`Cuboid`]s), obstacles such as columns, and guests such as a machine that drives through
//! ([`Cuboid`]s too).
//! Rays, volumes and collisions are answered from these same solids, so a volume is the volume of
//! the very surface that the LiDAR sees.
//!
//! ```text
//!   y ▲  ┌──────────────────────────┐ hall: 2 m around the region
//!     │  │   ┌──────────────────┐   │
//!     │  │   │ region, material │   │ +x wall: markers in front of the camera
//!     │  │ ▣ └──────────────────┘   │ ▣ pad, beside the x_min edge
//!     │  └──────────────────────────┘
//!     └─────────────────────────────▶ x
//! ```

mod alps;
mod bay;
mod columns;
mod error;
mod esri;
mod fractal;
mod height_field;
mod l_hall;
mod piles;
mod poor_fix;
mod solids;
mod tags;

pub use bay::Bay;
pub use error::WorldError;
pub use esri::GridScale;
pub use height_field::HeightField;
pub use solids::{Cuboid, Region};
pub use tags::PlacedTag;

use stockpilot::geometry::{Hall, Point};
use stockpilot::stats::SeedBook;

/// Free floor between the region of interest and the walls of the hall, m.
pub const AISLE_M: f64 = 2.0;
/// Height of the ceiling over the floor, m.
pub const CEILING_M: f64 = 10.0;
/// Height of the level ground around the hall, m.
pub const OUTSIDE_M: f64 = -1.5;

/// Where the vehicle starts and lands.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pad {
    /// Middle of the pad on the floor.
    pub position: Point<Hall>,
    /// Heading of a vehicle on it, rad, from x towards y.
    pub yaw_rad: f64,
}

/// A hall with everything in it.
#[derive(Debug, Clone)]
pub struct World {
    /// What people call it.
    pub name: String,
    /// The material, by its height over the floor.
    pub terrain: HeightField,
    /// The region of interest D, the extent of `terrain`.
    pub region: Region,
    /// Inner faces of floor, walls and ceiling.
    pub hall: Cuboid,
    /// Solid walls of the bays; part of the hall, not of the material. They do not overlap.
    pub walls_inside: Vec<Cuboid>,
    /// The smallest box around `walls_inside`.
    pub(crate) walls_bounds: Option<Cuboid>,
    /// What stands or hangs in the way of a flight, and is in every plan of the hall: columns,
    /// bridges. What stands on the floor takes the place of material, as walls do.
    pub obstacles: Vec<Cuboid>,
    /// Corners (x, y) of the inner faces of the walls, counter-clockwise, m.
    pub outline_m: Vec<[f64; 2]>,
    /// What stands or drives in the hall now and is neither hall nor material, on the floor.
    pub guests: Vec<Cuboid>,
    /// Holes in the shell of the hall: flat boxes in its faces, through which beams leave.
    pub openings: Vec<Cuboid>,
    /// The places whose volume is of interest by itself.
    pub bays: Vec<Bay>,
    /// The markers on the walls.
    pub tags: Vec<PlacedTag>,
    /// Where flights begin.
    pub pad: Pad,
}

impl World {
    /// A mountain landscape of 20 m × 20 m with at most 4 m relief.
    ///
    /// # Errors
    /// [`WorldError::BadField`] never in practice: the field is generated.
    pub fn alps(seed: u64) -> Result<Self, WorldError> {
        Self::steep_alps(seed, 1.0)
    }

    /// The same relief as [`Self::alps`] with `steepness` times its slopes: everything is this much
    /// narrower, so there is more of it.
    ///
    /// # Errors
    /// [`WorldError::BadField`] for a steepness that is not above zero.
    pub fn steep_alps(seed: u64, steepness: f64) -> Result<Self, WorldError> {
        let terrain = alps::terrain(SeedBook::new(seed), steepness)?;
        Ok(Self::assemble("alps", terrain, Vec::new(), SeedBook::new(seed)))
    }

    /// Heaps at the angle of repose, some of them in bays of concrete, on 20 m × 20 m.
    ///
    /// # Errors
    /// [`WorldError::BadField`] never in practice: the field is generated.
    pub fn piles(seed: u64) -> Result<Self, WorldError> {
        Self::steep_piles(seed, 1.0)
    }

    /// Heaps as in [`Self::piles`] with `steepness` times their slopes; they get narrower, and
    /// where the walls or the border hold them, higher, up to the same limits.
    ///
    /// # Errors
    /// [`WorldError::BadField`] for a steepness that is not above zero.
    pub fn steep_piles(seed: u64, steepness: f64) -> Result<Self, WorldError> {
        let terrain = piles::terrain(SeedBook::new(seed), steepness)?;
        let world = Self::assemble("piles", terrain, piles::bay_walls(), SeedBook::new(seed));
        Ok(Self { bays: piles::bays(), ..world })
    }

    /// Heaps and bays as in [`Self::steep_piles`] among columns that bear the roof.
    ///
    /// # Errors
    /// [`WorldError::BadField`] for a steepness that is not above zero.
    pub fn columns(seed: u64, steepness: f64) -> Result<Self, WorldError> {
        let world = Self::steep_piles(seed, steepness)?;
        let obstacles = columns::columns(SeedBook::new(seed), world.hall.max_m.z);
        Ok(Self { name: "columns".to_owned(), obstacles, ..world })
    }

    /// The landscape of [`Self::steep_alps`] in a hall with the shape of an L.
    ///
    /// # Errors
    /// [`WorldError::BadField`] for a steepness that is not above zero.
    pub fn l_hall(seed: u64, steepness: f64) -> Result<Self, WorldError> {
        let seeds = SeedBook::new(seed);
        let terrain = alps::terrain(seeds, steepness)?;
        let hall = Cuboid::over(&terrain.region().grown(AISLE_M), 0.0, CEILING_M);
        let block = l_hall::block(seeds, &hall);
        let mut world = Self::assemble("l-hall", terrain, vec![block], seeds);
        tags::hang_around(&mut world.tags, &hall, &block, &mut seeds.stream("world.tags.block"));
        world.outline_m = l_hall::outline(&hall, &block);
        // The landscape reaches the block; markers below it would be buried.
        let World { tags, terrain, .. } = &mut world;
        tags.retain(|tag| {
            let before = tag.centre().coords + 0.1 * tag.normal.coords;
            before.z - 0.5 * tag.edge_m > terrain.height_at(before.x, before.y)
        });
        Ok(world)
    }

    /// The landscape of [`Self::steep_alps`] in a hall where a part of the markers is gone.
    ///
    /// # Errors
    /// [`WorldError::BadField`] for a steepness that is not above zero.
    pub fn poor_fix(seed: u64, steepness: f64) -> Result<Self, WorldError> {
        let world = Self::steep_alps(seed, steepness)?;
        let tags = poor_fix::left_over(SeedBook::new(seed), &world.hall, world.tags);
        Ok(Self { name: "poor-fix".to_owned(), tags, ..world })
    }

    /// The landscape of an ESRI ASCII grid, scaled, with its lowest point on the floor.
    ///
    /// The region reaches from the first to the last cell centre and starts at (0, 0); the file's
    /// first row is north, which is +y.
    ///
    /// # Errors
    /// [`WorldError`] with the line that cannot be understood; cells without data are refused.
    pub fn from_esri_ascii(name: &str, text: &str, scale: GridScale) -> Result<Self, WorldError> {
        let terrain = esri::parse(text, scale)?;
        Ok(Self::assemble(name, terrain, Vec::new(), SeedBook::new(0)))
    }

    /// The hall around any material and any disjoint inside walls.
    #[must_use]
    pub fn assemble(
        name: &str,
        terrain: HeightField,
        walls_inside: Vec<Cuboid>,
        seeds: SeedBook,
    ) -> Self {
        let region = terrain.region();
        let hall = Cuboid::over(&region.grown(AISLE_M), 0.0, CEILING_M);
        let pad = pad_beside(&region);
        let tags = tags::placed(&hall, &pad, &mut seeds.stream("world.tags"));
        let walls_bounds = Cuboid::around(&walls_inside);
        let outline_m = Bay::rectangle("walls", &hall.footprint()).outline_m;
        Self {
            name: name.to_owned(),
            terrain,
            region,
            hall,
            walls_inside,
            walls_bounds,
            obstacles: Vec::new(),
            outline_m,
            guests: Vec::new(),
            openings: Vec::new(),
            bays: Vec::new(),
            tags,
            pad,
        }
    }

    /// Height of the highest solid on the floor at (x, y): material, inside wall or obstacle, m.
    #[must_use]
    pub fn height_at(&self, x_m: f64, y_m: f64) -> f64 {
        self.terrain.height_at(x_m, y_m).max(self.base_height(x_m, y_m))
    }

    /// Walls inside the hall and the obstacles on its floor.
    fn standing(&self) -> impl Iterator<Item = &Cuboid> {
        let on_floor = |obstacle: &&Cuboid| obstacle.min_m.z <= 0.0;
        self.walls_inside.iter().chain(self.obstacles.iter().filter(on_floor))
    }

    /// Height of what lies below the material at (x, y): the top of what stands on the floor there,
    /// else 0, m.
    #[must_use]
    pub fn base_height(&self, x_m: f64, y_m: f64) -> f64 {
        let standing = self.standing().filter(|wall| wall.covers(x_m, y_m));
        standing.map(|wall| wall.max_m.z).fold(0.0, f64::max)
    }

    /// Volume of the material over the region of interest, m³.
    #[must_use]
    pub fn volume_m3(&self) -> f64 {
        self.true_volume_m3(&self.region)
    }

    /// Volume of the material over a rectangle, m³.
    ///
    /// ```text
    /// V = ∫ (surface − base) dA = ∫ h dA − Σ_walls ∫ min(h, top) dA
    /// ```
    /// - `h`: height of the material if no wall stood there, m; its integral is exact
    ///
    /// Only the integrals over the walls are numeric; they are good to 1 mm of height.
    #[must_use]
    pub fn true_volume_m3(&self, over: &Region) -> f64 {
        let displaced = |wall: &Cuboid| {
            let below_top = over.overlap(&wall.footprint());
            below_top.map_or(0.0, |area| self.terrain.integral_below_m3(&area, wall.max_m.z))
        };
        self.terrain.integral_m3(over) - self.standing().map(displaced).sum::<f64>()
    }

    /// Volume of the material in a bay, m³, in the sense of [`Self::true_volume_m3`].
    #[must_use]
    pub fn bay_volume_m3(&self, bay: &Bay) -> f64 {
        let outline_m = &bay.outline_m;
        let displaced = |wall: &Cuboid| {
            self.terrain.integral_below_within_m3(outline_m, &wall.footprint(), wall.max_m.z)
        };
        self.terrain.integral_within_m3(outline_m) - self.standing().map(displaced).sum::<f64>()
    }

    /// The hall with a gate in its low-y wall and a skylight, both at drawn places; markers that
    /// hung there are gone.
    #[must_use]
    pub fn with_gaps(mut self, seeds: SeedBook) -> Self {
        const GATE_M: (f64, f64) = (4.0, 4.0);
        const SKYLIGHT_M: (f64, f64) = (1.5, 6.0);
        let mut noise = seeds.stream("world.gaps");
        let region = &self.region;
        // Away from the markers that are read from the pad.
        let gate_x_m = region.x_min_m + noise.between(0.5, 0.8) * region.length_m();
        let wall_m = self.hall.min_m.y;
        let gate = Region::new(gate_x_m, wall_m, gate_x_m + GATE_M.0, wall_m);
        let light_x_m = region.x_min_m + noise.between(0.1, 0.9) * region.length_m();
        let light_y_m = region.y_min_m + noise.between(0.1, 0.6) * region.width_m();
        let skylight =
            Region::new(light_x_m, light_y_m, light_x_m + SKYLIGHT_M.0, light_y_m + SKYLIGHT_M.1);
        let ceiling_m = self.hall.max_m.z;
        self.openings =
            vec![Cuboid::over(&gate, 0.0, GATE_M.1), Cuboid::over(&skylight, ceiling_m, ceiling_m)];
        let (openings, tags) = (&self.openings, &mut self.tags);
        tags.retain(|tag| {
            let is_gone = |opening: &Cuboid| {
                tag.corners.iter().any(|corner| opening.distance_m(&corner.coords) < 1e-6)
            };
            !openings.iter().any(is_gone)
        });
        self
    }

    /// Distance from a point to the nearest solid, m: at most `reach_m`, and 0 inside a solid.
    ///
    /// Material counts by the nodes of its grid, so the answer is good to half a grid pitch.
    #[must_use]
    pub fn clearance_m(&self, p: &Point<Hall>, reach_m: f64) -> f64 {
        let solids = self.walls_inside.iter().chain(&self.obstacles).chain(&self.guests);
        let walls = solids.map(|wall| wall.distance_m(&p.coords));
        let nearest_wall = walls.fold(reach_m, f64::min);
        let to_hall = self.hall.depth_m(&p.coords);
        let to_material = self.terrain.distance_m(&p.coords, reach_m);
        nearest_wall.min(to_hall).min(to_material).max(0.0)
    }
}

/// A place from which the launch markers and the clear floor along the low-y wall can be seen.
fn pad_beside(region: &Region) -> Pad {
    const BESIDE_M: f64 = 1.2;
    const ALONG_M: f64 = 0.5;
    let position = Point::new(region.x_min_m - BESIDE_M, region.y_min_m + ALONG_M, 0.0);
    Pad { position, yaw_rad: 0.0 }
}

#[cfg(test)]
pub(crate) mod tests;
