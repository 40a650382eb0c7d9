//! Numbers that a calibration has found, put into the file in place of the old ones; comments stay.

use super::error::ConfigError;
use super::file::Config;
use crate::geometry::{Body, Lidar, Transform};
use atomic_write_file::AtomicWriteFile;
use std::fs;
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use toml_edit::{Array, DocumentMut, InlineTable, Item, Table, Value, value};

/// A mounting with how well it is known.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FoundMount {
    /// The LiDAR on the body.
    pub body_from_lidar: Transform<Body, Lidar>,
    /// Standard deviation of its place, each axis, m.
    pub position_sigma_m: f64,
    /// Standard deviation of its direction, about each axis, rad.
    pub rotation_sigma_rad: f64,
}

/// Writes the mounting into a configuration file. The file is replaced as a whole or not at all.
///
/// # Errors
/// A file that cannot be read or replaced, or that is no configuration.
pub fn write_mount(path: &Path, found: &FoundMount) -> Result<(), ConfigError> {
    let unreadable = |source: io::Error| ConfigError::Unreadable { path: path.to_owned(), source };
    let text = fs::read_to_string(path).map_err(unreadable)?;
    let edited = with_mount(&text, path, found)?;
    replace(path, &edited).map_err(unreadable)
}

/// Writes the offset of the stamps and its standard deviation, s.
///
/// # Errors
/// As [`write_mount`].
pub fn write_clock(path: &Path, offset_s: f64, sigma_s: f64) -> Result<(), ConfigError> {
    let unreadable = |source: io::Error| ConfigError::Unreadable { path: path.to_owned(), source };
    let text = fs::read_to_string(path).map_err(unreadable)?;
    let edited = edited(&text, path, |document| {
        document["lidar"]["clock_offset_ms"] = value(to_step(1e3 * offset_s, 1e-3));
        let sigma_ms = to_step(1e3 * sigma_s, 1e-3);
        uncertainty_of(document)["clock_offset_sigma_ms"] = value(sigma_ms);
    })?;
    replace(path, &edited).map_err(unreadable)
}

/// Writes where the surveyed markers stand, beside the configuration if they do, and how well their places are known, 1σ, m.
///
/// # Errors
/// As [`write_mount`]; a tag of the file that stands in the configuration itself, too: nothing would say which place
/// counts.
pub fn write_markers(path: &Path, markers: &Path, sigma_m: f64) -> Result<(), ConfigError> {
    let unreadable = |source: io::Error| ConfigError::Unreadable { path: path.to_owned(), source };
    let text = fs::read_to_string(path).map_err(unreadable)?;
    let named = beside(path, markers).map_err(unreadable)?;
    let edited = edited(&text, path, |document| {
        let section = document.entry("markers").or_insert_with(|| Item::Table(Table::new()));
        section["file"] = value(named.to_string_lossy().into_owned());
        // No σ at all would call the places exact.
        let sigma_m = to_step(sigma_m, 1e-4).max(1e-4);
        uncertainty_of(document)["marker_sigma_m"] = value(sigma_m);
    })?;
    // With the files that it names, as a start would read it.
    let directory = path.parent().unwrap_or(Path::new(""));
    Config::from_toml(&edited, path)?.with_files_read(directory)?.marker_map()?;
    replace(path, &edited).map_err(unreadable)
}

/// The name of a file for a configuration: without its folder if that is the configuration's own.
fn beside(config: &Path, file: &Path) -> io::Result<PathBuf> {
    let (config, file) = (fs::canonicalize(config)?, fs::canonicalize(file)?);
    let inside = config.parent().and_then(|folder| file.strip_prefix(folder).ok());
    Ok(inside.map_or_else(|| file.clone(), Path::to_owned))
}

/// What a wall at taped distances has shown of the ranges.
#[derive(Debug, Clone, PartialEq)]
pub struct FoundRange {
    /// Ranges come out longer by this, m, and its standard deviation.
    pub bias_m: (f64, f64),
    /// They come out longer by this share, and its standard deviation; `None` leaves what stands.
    pub scale: Option<(f64, f64)>,
    /// Standard deviation of one range, m.
    pub noise_m: f64,
    /// Directions in which the LiDAR sees the vehicle, °, from −180 to 180; added to those that stand.
    pub blind_sectors_deg: Vec<[f64; 2]>,
}

/// Writes bias, scale and noise of the ranges with their standard deviations, and blind sectors.
///
/// # Errors
/// As [`write_mount`].
pub fn write_range(path: &Path, found: &FoundRange) -> Result<(), ConfigError> {
    let unreadable = |source: io::Error| ConfigError::Unreadable { path: path.to_owned(), source };
    let text = fs::read_to_string(path).map_err(unreadable)?;
    let edited = with_range(&text, path, found)?;
    replace(path, &edited).map_err(unreadable)
}

fn with_range(text: &str, path: &Path, found: &FoundRange) -> Result<String, ConfigError> {
    let before = Config::from_toml(text, path)?.lidar.blind_sectors_deg;
    let sectors = united(&before, &found.blind_sectors_deg);
    edited(text, path, |document| {
        let lidar = &mut document["lidar"];
        lidar["range_bias_m"] = value(to_step(found.bias_m.0, 1e-5));
        lidar["range_sigma_m"] = value(to_step(found.noise_m, 1e-5));
        if let Some((scale, _)) = found.scale {
            lidar["range_scale"] = value(to_step(scale, 1e-6));
        }
        if sectors != before {
            let pair = |ends: &[f64; 2]| Value::from(ends.iter().copied().collect::<Array>());
            lidar["blind_sectors_deg"] = value(sectors.iter().map(pair).collect::<Array>());
        }
        let uncertainty = uncertainty_of(document);
        uncertainty["range_bias_sigma_m"] = value(to_step(found.bias_m.1, 1e-5));
        if let Some((_, sigma)) = found.scale {
            uncertainty["range_scale_sigma"] = value(to_step(sigma, 1e-6));
        }
    })
}

/// Both lists as one without overlaps, in order; as it stands if the new ones lie inside.
fn united(standing: &[[f64; 2]], new: &[[f64; 2]]) -> Vec<[f64; 2]> {
    let is_inside = |n: &&[f64; 2]| !standing.iter().any(|s| s[0] <= n[0] && n[1] <= s[1]);
    let new: Vec<[f64; 2]> = new.iter().filter(is_inside).copied().collect();
    if new.is_empty() {
        return standing.to_vec();
    }
    let mut all = [standing, &new].concat();
    all.sort_by(|a, b| a[0].total_cmp(&b[0]));
    let mut united: Vec<[f64; 2]> = Vec::new();
    for [from, to] in all {
        match united.last_mut() {
            Some(last) if from <= last[1] => last[1] = last[1].max(to),
            _ => united.push([from, to]),
        }
    }
    united
}

fn with_mount(text: &str, path: &Path, found: &FoundMount) -> Result<String, ConfigError> {
    let (roll, pitch, yaw) = found.body_from_lidar.rotation.euler_rad();
    let place = found.body_from_lidar.origin.coords;
    let mut mount = InlineTable::new();
    mount.insert("position_m", rounded([place.x, place.y, place.z], 1e-4));
    mount.insert("rotation_deg", rounded([roll, pitch, yaw].map(f64::to_degrees), 1e-4));
    edited(text, path, |document| {
        document["lidar"]["mount"] = value(mount);
        let uncertainty = uncertainty_of(document);
        uncertainty["mount_position_sigma_m"] = value(to_step(found.position_sigma_m, 1e-4));
        uncertainty["mount_rotation_sigma_deg"] =
            value(to_step(found.rotation_sigma_rad.to_degrees(), 1e-3));
    })
}

fn edited(
    text: &str,
    path: &Path,
    edit: impl FnOnce(&mut DocumentMut),
) -> Result<String, ConfigError> {
    let file = |message: String| ConfigError::File { path: path.to_owned(), message };
    Config::from_toml(text, path)?;
    let mut document: DocumentMut =
        text.parse().map_err(|error: toml_edit::TomlError| file(error.to_string()))?;
    edit(&mut document);
    let edited = document.to_string();
    // What was written must be what was meant.
    Config::from_toml(&edited, path)?;
    Ok(edited)
}

/// The table `[surface.uncertainty]`, made if it is missing.
fn uncertainty_of(document: &mut DocumentMut) -> &mut Item {
    let surface = document.entry("surface").or_insert_with(|| {
        let mut surface = Table::new();
        surface.set_implicit(true);
        Item::Table(surface)
    });
    let uncertainty = &mut surface["uncertainty"];
    if uncertainty.is_none() {
        *uncertainty = Item::Table(Table::new());
    }
    uncertainty
}

fn rounded(values: [f64; 3], step: f64) -> Value {
    values.map(|v| to_step(v, step)).into_iter().collect::<Array>().into()
}

/// The nearest multiple of 1/round(1/step), printed short.
fn to_step(number: f64, step: f64) -> f64 {
    let per_unit = (1.0 / step).round();
    (number * per_unit).round() / per_unit
}

/// Mode and owner stay; a power cut leaves the old file or the new one.
fn replace(path: &Path, text: &str) -> io::Result<()> {
    let mut file = AtomicWriteFile::open(path)?;
    file.write_all(text.as_bytes())?;
    file.commit()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{Point, Rotation};
    use nalgebra::Vector3;

    const EXAMPLE: &str = include_str!("../../deploy/config.example.toml");

    #[test]
    fn the_mounting_is_replaced_and_the_rest_stays() {
        let nominal = Transform::<Body, Lidar>::new(
            Rotation::from_euler_rad(0.0, std::f64::consts::FRAC_PI_2, 0.0),
            Point::new(0.08, 0.0, -0.06),
        );
        let turn = Vector3::new(0.01, -0.02, 0.005);
        let found = FoundMount {
            body_from_lidar: nominal.perturbed(&Vector3::new(0.0123, -0.004, 0.002), &turn),
            position_sigma_m: 0.00123,
            rotation_sigma_rad: 0.0005,
        };
        let edited = with_mount(EXAMPLE, Path::new("example"), &found).expect("edited");
        let config = Config::from_toml(&edited, Path::new("edited")).expect("valid");
        let lidar = config.pilot_settings().expect("in range").mapping.lidar;
        let off = lidar.body_from_lidar.rotation.minus(&found.body_from_lidar.rotation);
        assert!(off.norm() < 5e-6, "{off:?}");
        let moved_m = (lidar.body_from_lidar.origin - found.body_from_lidar.origin).coords;
        assert!(moved_m.norm() < 1e-4, "{moved_m:?}");
        let uncertainty = config.surface.uncertainty;
        assert!((uncertainty.mount_position_sigma_m - 0.0012).abs() < 1e-9);
        assert!((uncertainty.mount_rotation_sigma_deg - 0.029).abs() < 1e-9);
        // Only those three lines differ.
        let changed = EXAMPLE.lines().zip(edited.lines()).filter(|(a, b)| a != b).count();
        assert_eq!((changed, EXAMPLE.lines().count()), (3, edited.lines().count()));
    }

    #[test]
    fn ranges_are_replaced_and_blind_sectors_united() {
        let found = FoundRange {
            bias_m: (0.0213, 0.0018),
            scale: Some((-0.0008, 0.0004)),
            noise_m: 0.0091,
            blind_sectors_deg: vec![[-130.0, -110.0], [40.0, 52.0], [150.0, 160.0]],
        };
        let edited = with_range(EXAMPLE, Path::new("example"), &found).expect("edited");
        let config = Config::from_toml(&edited, Path::new("edited")).expect("valid");
        let mapping = config.pilot_settings().expect("in range").mapping;
        assert!((config.lidar.range_bias_m - 0.0213).abs() < 1e-12);
        assert!((config.lidar.range_scale + 0.0008).abs() < 1e-12);
        assert!((config.surface.uncertainty.range_bias_sigma_m - 0.0018).abs() < 1e-12);
        assert!((config.surface.uncertainty.range_scale_sigma - 0.0004).abs() < 1e-12);
        assert!((mapping.lidar.range_sigma_m - 0.0091).abs() < 1e-12);
        // The file has −180 to −120 and 120 to 180.
        let sectors = [[-180.0, -110.0], [40.0, 52.0], [120.0, 180.0]];
        assert_eq!(config.lidar.blind_sectors_deg, sectors);
        let changed = EXAMPLE.lines().zip(edited.lines()).filter(|(a, b)| a != b).count();
        assert_eq!((changed, EXAMPLE.lines().count()), (6, edited.lines().count()));

        // What stands already stays as it is written, and a scale that was not seen too.
        let less = FoundRange { scale: None, blind_sectors_deg: vec![[130.0, 140.0]], ..found };
        let edited = with_range(EXAMPLE, Path::new("example"), &less).expect("edited");
        let changed = EXAMPLE.lines().zip(edited.lines()).filter(|(a, b)| a != b).count();
        assert_eq!(changed, 3);
    }

    #[test]
    fn surveyed_markers_are_named_beside_the_file_with_their_sigma() {
        let folder = tempfile::tempdir().expect("a folder");
        let (path, markers) =
            (folder.path().join("hall.toml"), folder.path().join("surveyed.toml"));
        let tag = "[[tags]]\nfamily = \"36h11\"\nid = 40\ncorners_m = [[22.0, 10.25, 2.0], \
                   [22.0, 9.75, 2.0], [22.0, 9.75, 2.5], [22.0, 10.25, 2.5]]\n";
        fs::write(&path, EXAMPLE).expect("written");
        fs::write(&markers, tag).expect("written");
        write_markers(&path, &markers, 0.00234).expect("edited");
        let config = super::super::load(&path, &[]).expect("valid");
        assert!((config.surface.uncertainty.marker_sigma_m - 0.0023).abs() < 1e-12);
        assert!(config.tags.iter().any(|tag| tag.id == 40), "the file is read");
        let text = fs::read_to_string(&path).expect("read");
        assert!(text.contains("file = \"surveyed.toml\""), "{text}");
        // A map that is known without error is not known at all.
        write_markers(&path, &markers, 0.0).expect("edited");
        let config = super::super::load(&path, &[]).expect("valid");
        assert!((config.surface.uncertainty.marker_sigma_m - 1e-4).abs() < 1e-12);

        // The example has a tag 0 of its own.
        let before = fs::read_to_string(&path).expect("read");
        fs::write(&markers, tag.replace("id = 40", "id = 0")).expect("written");
        let refusal = write_markers(&path, &markers, 0.002).expect_err("twice");
        assert!(refusal.to_string().contains('0'), "{refusal}");
        assert_eq!(fs::read_to_string(&path).expect("read"), before);
    }

    #[test]
    fn a_file_without_the_section_gets_it() {
        let start = EXAMPLE.find("[surface]").expect("a section");
        let end = EXAMPLE.find("[planning]").expect("a section");
        let short = format!("{}{}", &EXAMPLE[..start], &EXAMPLE[end..]);
        let found = FoundMount {
            body_from_lidar: Transform::new(Rotation::identity(), Point::new(0.1, 0.0, 0.0)),
            position_sigma_m: 0.002,
            rotation_sigma_rad: 0.001,
        };
        let edited = with_mount(&short, Path::new("short"), &found).expect("edited");
        let config = Config::from_toml(&edited, Path::new("edited")).expect("valid");
        assert!((config.surface.uncertainty.mount_position_sigma_m - 0.002).abs() < 1e-12);
    }

    #[test]
    fn the_file_is_replaced_on_disk() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("hall.toml");
        fs::write(&path, EXAMPLE).expect("written");
        let found = FoundMount {
            body_from_lidar: Transform::new(Rotation::identity(), Point::new(0.1, 0.0, 0.0)),
            position_sigma_m: 0.002,
            rotation_sigma_rad: 0.001,
        };
        write_mount(&path, &found).expect("written");
        let config = super::super::load(&path, &[]).expect("valid");
        assert!((config.lidar.mount.position_m[0] - 0.1).abs() < 1e-12);
        assert_eq!(fs::read_dir(folder.path()).expect("a folder").count(), 1);
    }
}
