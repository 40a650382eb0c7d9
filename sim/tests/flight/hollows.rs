//! What grazing beams miss of rough ground: the service's formula against beams cast on it.

use stockpilot::geometry::{Direction, Point};
use stockpilot::mapping::roughness::hidden_m;
use stockpilot_sim::raycast::{Surface, cast};
use stockpilot_sim::world::World;

/// Mean of the ground around a place, weighted as bilinear nodes weigh it.
fn ground_of_nodes_m(world: &World, x: f64, y: f64, cell_m: f64) -> f64 {
    const PARTS: i32 = 5;
    let (mut sum, mut total) = (0.0, 0.0);
    for i in -PARTS..=PARTS {
        for j in -PARTS..=PARTS {
            let (u, v) = (f64::from(i) / f64::from(PARTS), f64::from(j) / f64::from(PARTS));
            let weight = (1.0 - u.abs()) * (1.0 - v.abs());
            sum += weight * world.height_at(x + u * cell_m, y + v * cell_m);
            total += weight;
        }
    }
    sum / total
}

#[test]
fn hidden_hollows_match_cast_beams() {
    let (cell_m, roughness_m) = (0.25, 0.040);
    // Means over beams by their descent towards the ground, per metre of way: 0.4 to 0.8, … 2.0.
    let mut bins = [(0.0, 0.0, 0.0); 4];
    for seed in 0..3 {
        let world = World::steep_alps(seed, 2.0).expect("a world");
        for leg in 0..4 {
            for place in 0..48 {
                let origin =
                    Point::new(1.0 + 0.37 * f64::from(place), 2.5 + 5.0 * f64::from(leg), 7.0);
                for k in -62..=62 {
                    let angle = 0.02 * f64::from(k);
                    let direction = Direction::new(0.0, angle.sin(), -angle.cos());
                    let Some(hit) = cast(&world, &origin, &direction, 12.0) else { continue };
                    let p = origin.coords + direction.coords * hit.distance_m;
                    let is_inside = (0.4..19.6).contains(&p.x) && (0.4..19.6).contains(&p.y);
                    if hit.surface != Surface::Material || !is_inside || k == 0 {
                        continue;
                    }
                    let ground = |y: f64| ground_of_nodes_m(&world, p.x, y, cell_m);
                    let slope = (ground(p.y + 0.05) - ground(p.y - 0.05)) / 0.1;
                    let descent = 1.0 / angle.abs().tan() + slope * angle.signum();
                    if (0.4..2.0).contains(&descent) {
                        #[expect(clippy::cast_possible_truncation, reason = "0 to 3")]
                        #[expect(clippy::cast_sign_loss, reason = "0 to 3")]
                        let bin = &mut bins[((descent - 0.4) / 0.4) as usize];
                        bin.0 += 1.0;
                        bin.1 += p.z - ground(p.y);
                        bin.2 += hidden_m(roughness_m, cell_m, descent);
                    }
                }
            }
        }
    }
    for (n, measured_m, predicted_m) in bins {
        let (measured_mm, predicted_mm) = (1e3 * measured_m / n, 1e3 * predicted_m / n);
        let near = 1.0 + 0.25 * predicted_mm;
        assert!(
            (measured_mm - predicted_mm).abs() < near,
            "{measured_mm} {predicted_mm} mm of {n}"
        );
    }
}
