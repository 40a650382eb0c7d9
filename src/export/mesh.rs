//! The surface as triangles.

use super::Surface;
use std::fmt::Write as _;

/// A Wavefront OBJ: a vertex at the centre of every cell that counts, two triangles between four
/// neighbours, their front upwards; metres, z up.
#[must_use]
pub fn obj(surface: Surface<'_>) -> String {
    let (map, grid) = (surface.map, &surface.map.grid);
    let mut text =
        String::from("# stockpilot surface; metres in the hall's frame, z up\no surface\n");
    // Numbers of vertices count from 1.
    let mut vertex_of = vec![None; grid.n_cells()];
    let mut n_vertices = 0_usize;
    for cell in (0..grid.n_cells()).filter(|cell| surface.counts(*cell)) {
        let (x_m, y_m) = grid.centre_m(cell);
        // Writing into a text cannot fail.
        let _ok = writeln!(text, "v {x_m} {y_m} {}", map.mean_m[cell]);
        n_vertices += 1;
        vertex_of[cell] = Some(n_vertices);
    }
    for row in 1..grid.n_rows {
        for col in 1..grid.n_cols {
            let at = |col, row| vertex_of[grid.index(col, row)];
            let corners = (at(col - 1, row - 1), at(col, row - 1), at(col, row), at(col - 1, row));
            if let (Some(a), Some(b), Some(c), Some(d)) = corners {
                let _ok = writeln!(text, "f {a} {b} {c}\nf {a} {c} {d}");
            }
        }
    }
    text
}
