//! A map of kinds in plain colours, with a legend instead of a colour bar.

use super::canvas::{drawn, on_paper, part, write_title};
use super::heat_map::{BELOW, FRAME, LEFT, TOP, UNKNOWN, View, draw_axes};
use super::legend::{self, Entry, Sample};
use super::{Figure, FigureError, HeatMap, Ink, Lattice, Overlay, Table};
use plotters::prelude::Rectangle;
use plotters::style::{Color, ShapeStyle};

/// A map of kinds.
#[derive(Debug, Clone, PartialEq)]
pub struct ClassMap {
    /// What the picture shows.
    pub title: String,
    /// The number of each cell's kind, from 0; other values are unknown and drawn grey.
    pub grid: Lattice,
    /// What the kinds are called and their colours.
    pub classes: Vec<(String, Ink)>,
    /// What lies over the map, in the order of drawing.
    pub overlays: Vec<Overlay>,
}

/// Free room right of the map, as wide as a label on its axis.
const RIGHT: i32 = 24;

impl ClassMap {
    /// The same map with its numbers as a quantity: for the checks, axes and tables that both share.
    fn as_heat_map(&self) -> HeatMap {
        HeatMap {
            title: self.title.clone(),
            grid: self.grid.clone(),
            quantity: "kind".to_owned(),
            range: None,
            is_signed: false,
            overlays: self.overlays.clone(),
        }
    }

    fn ink_of(&self, value: f64) -> Option<Ink> {
        let is_it = |(index, _): &(usize, _)| {
            u32::try_from(*index).is_ok_and(|k| f64::from(k).to_bits() == value.to_bits())
        };
        self.classes.iter().enumerate().find(is_it).map(|(_, (_, ink))| *ink)
    }

    fn entries(&self, of_overlays: Vec<Entry>) -> Vec<Entry> {
        let of_class = |(label, ink): &(String, Ink)| Entry {
            label: label.clone(),
            sample: Sample::Band(*ink, 1.0),
        };
        self.classes.iter().map(of_class).chain(of_overlays).collect()
    }
}

impl Figure for ClassMap {
    fn svg(&self) -> Result<String, FigureError> {
        let map = self.as_heat_map();
        map.check()?;
        let view = View::of(&map);
        let (width, height) = view.size;
        let entries = self.entries(map.entries());
        let total = LEFT + width + RIGHT;
        let legend_height = legend::height(&entries, total - LEFT);
        let below_map = TOP + height + BELOW;
        let size = (total.unsigned_abs(), (below_map + legend_height).unsigned_abs());
        on_paper(size, |root| {
            write_title(root, &self.title, total, TOP)?;
            draw_axes(root, &view)?;
            let area = part(root, (LEFT, TOP), view.size);
            self.grid.for_each_run(
                |value| self.ink_of(value),
                |from_m, to_m, ink| {
                    let corners = [view.place(&from_m), view.place(&to_m)];
                    let colour = ink.map_or(UNKNOWN, Ink::rgb);
                    drawn(area.draw(&Rectangle::new(corners, colour.filled())))
                },
            )?;
            for overlay in &self.overlays {
                overlay.draw(&area, |point_m| view.place(point_m))?;
            }
            let frame = Rectangle::new([(0, 0), view.size], ShapeStyle::from(FRAME));
            drawn(area.draw(&frame))?;
            if legend_height > 0 {
                let area = part(root, (LEFT, below_map), (total - LEFT, legend_height));
                legend::draw(&area, &entries, total - LEFT)?;
            }
            Ok(())
        })
    }

    fn tables(&self) -> Vec<Table> {
        self.as_heat_map().tables()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_kind_has_its_colour_and_its_name() {
        let map = ClassMap {
            title: "Seen".to_owned(),
            grid: Lattice {
                x_min_m: 0.0,
                y_min_m: 0.0,
                cell_m: 1.0,
                n_cols: 2,
                values: vec![0.0, 1.0, f64::NAN, 7.0],
            },
            classes: vec![("measured".to_owned(), Ink::Green), ("unseen".to_owned(), Ink::Orange)],
            overlays: Vec::new(),
        };
        let svg = map.svg().expect("a picture");
        for expected in ["#009E73", "#E69F00", "#DEDEDE", "measured", "unseen"] {
            assert!(svg.contains(expected), "{expected}");
        }
        // Both unknown cells stand in one rectangle.
        assert_eq!(svg.matches("fill=\"#DEDEDE\"").count(), 1);
    }
}
