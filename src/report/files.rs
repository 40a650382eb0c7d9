//! The whole folder of a report: the report itself, maps, point clouds, and the list of all.

use super::{Facts, Report, ReportError};
use crate::export::{
    Cloud, ExportError, Surface, crs, esri_grid, geotiff, laz, obj, ply, sha256_of_bytes,
};
use std::fmt::Write as _;
use std::fs::File;
use std::io::{self, Write as _};
use std::path::Path;

/// The list of a folder's files, as `sha256sum --check` reads it.
pub const SUMS: &str = "SHA256SUMS";

/// A file of the folder.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ReportFile {
    /// Its name.
    pub name: &'static str,
    /// What it holds.
    pub bytes: Vec<u8>,
}

/// All files of a report in their order: the report, then what the log has of surface and hits.
///
/// # Errors
/// What cannot be stated, drawn or written.
pub fn report_files(facts: &Facts, log_sha256: &str) -> Result<Vec<ReportFile>, ReportError> {
    let mut files = Report::new(facts, log_sha256)?.into_files();
    files.extend(exports(facts)?);
    Ok(files)
}

fn exports(facts: &Facts) -> Result<Vec<ReportFile>, ExportError> {
    let flight = &facts.flight;
    let mut files = Vec::new();
    let mut add = |name, bytes| files.push(ReportFile { name, bytes });
    if let Some(map) = &flight.surface {
        let counts = flight.counting_cells();
        let surface = Surface { map, counts: &counts };
        add("height.tif", geotiff(surface)?);
        add("height.asc", esri_grid(surface, &map.mean_m).into_bytes());
        add("height.prj", crs::WKT.as_bytes().to_vec());
        add("sigma.asc", esri_grid(surface, &map.sigma_m).into_bytes());
        add("sigma.prj", crs::WKT.as_bytes().to_vec());
        add("surface.obj", obj(surface).into_bytes());
    }
    if !flight.hits.is_empty() {
        let cloud = Cloud { hits: &flight.hits, began_at: flight.began_at };
        add("hits.laz", laz(cloud)?);
        add("hits.ply", ply(cloud));
    }
    Ok(files)
}

/// Writes files and the list of their SHA-256 sums into a folder, which must exist; files of the same
/// names are replaced. When it returns, they are on the disk: the log may be deleted from then on.
///
/// # Errors
/// A file that cannot be written.
pub fn write_files(files: &[ReportFile], folder: &Path) -> Result<(), ReportError> {
    let mut sums = String::new();
    for ReportFile { name, bytes } in files {
        // Writing into a text cannot fail.
        let _ok = writeln!(sums, "{}  {name}", sha256_of_bytes(bytes));
        write(&folder.join(name), bytes)?;
    }
    write(&folder.join(SUMS), sums.as_bytes())?;
    sync_folder(folder).map_err(|source| ReportError::File { path: folder.to_owned(), source })
}

fn write(path: &Path, bytes: &[u8]) -> Result<(), ReportError> {
    write_to_disk(path, bytes).map_err(|source| ReportError::File { path: path.to_owned(), source })
}

/// Writes a file and waits until the disk has it; its name only [`sync_folder`] brings there.
///
/// # Errors
/// What the disk says.
pub(crate) fn write_to_disk(path: &Path, bytes: &[u8]) -> io::Result<()> {
    let mut file = File::create(path)?;
    file.write_all(bytes)?;
    file.sync_all()
}

/// Brings the names in a folder to the disk, and the folder's own.
///
/// # Errors
/// What the disk says.
pub(crate) fn sync_folder(folder: &Path) -> io::Result<()> {
    let folder = folder.canonicalize()?;
    for folder in folder.ancestors().take(2) {
        File::open(folder)?.sync_all()?;
    }
    Ok(())
}
