//! Triangles out of STL and OBJ files.

use super::convert::invalid;
use super::error::ConfigError;
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};
use std::io::{BufReader, Cursor};
use std::path::Path;

/// What a mesh file holds, in its own units and axes.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MeshContent {
    /// Corners.
    pub corners: Vec<[f64; 3]>,
    /// Triangles by the numbers of their corners, from 0.
    pub triangles: Vec<[usize; 3]>,
}

/// More triangles than this are refused: every log holds them.
const MAX_TRIANGLES: usize = 100_000;
/// Larger files are not read, bytes.
const MAX_BYTES: u64 = 50_000_000;

/// Reads a file by its ending.
pub(super) fn read(key: &str, path: &Path) -> Result<MeshContent, ConfigError> {
    let unreadable = |source| ConfigError::Unreadable { path: path.to_owned(), source };
    let refuse = |message: String| invalid(key, format!("{}: {message}", path.display()));
    let size = std::fs::metadata(path).map_err(unreadable)?.len();
    if size > MAX_BYTES {
        return Err(refuse(format!("{size} bytes; at most {MAX_BYTES} are read")));
    }
    let bytes = std::fs::read(path).map_err(unreadable)?;
    let ending = path.extension().map(|ending| ending.to_ascii_lowercase());
    let content = match ending.as_deref().and_then(|ending| ending.to_str()) {
        Some("stl") => stl(&bytes),
        Some("obj") => obj(&bytes),
        _ => Err("is neither .stl nor .obj".to_owned()),
    };
    let content = content.map_err(refuse)?;
    match content.triangles.len() {
        0 => Err(refuse("holds no triangle".to_owned())),
        n if n > MAX_TRIANGLES => {
            Err(refuse(format!("holds {n} triangles; at most {MAX_TRIANGLES} are taken")))
        }
        _ => Ok(content),
    }
}

fn stl(bytes: &[u8]) -> Result<MeshContent, String> {
    let mesh = stl_io::read_stl(&mut Cursor::new(bytes)).map_err(|e| format!("is no STL: {e}"))?;
    Ok(MeshContent {
        corners: mesh.vertices.iter().map(|corner| corner.0.map(f64::from)).collect(),
        triangles: mesh.faces.iter().map(|face| face.vertices).collect(),
    })
}

fn obj(bytes: &[u8]) -> Result<MeshContent, String> {
    let options = tobj::LoadOptions { triangulate: true, ..tobj::LoadOptions::default() };
    // Colours do not matter, so files of materials are not looked for.
    let no_material = |_: &Path| Err(tobj::LoadError::OpenFileFailed);
    let (models, _) = tobj::load_obj_buf(&mut BufReader::new(bytes), &options, no_material)
        .map_err(|error| format!("is no OBJ: {error}"))?;
    let mut content = MeshContent { corners: Vec::new(), triangles: Vec::new() };
    for model in models {
        let first = content.corners.len();
        let (corners, rest) = model.mesh.positions.as_chunks::<3>();
        let (triangles, odd) = model.mesh.indices.as_chunks::<3>();
        if !rest.is_empty() || !odd.is_empty() {
            return Err(format!("{:?} has points or lines among its faces", model.name));
        }
        content.corners.extend(corners);
        content.triangles.extend(triangles.iter().map(|t| t.map(|corner| first + corner as usize)));
    }
    Ok(content)
}

/// The triangles by their places.
pub(super) fn triangles(
    key: &str,
    content: &MeshContent,
) -> Result<Vec<[Vector3<f64>; 3]>, ConfigError> {
    let triangle = |(index, corners): (usize, &[usize; 3])| {
        let mut places = [Vector3::zeros(); 3];
        for (place, corner) in places.iter_mut().zip(corners) {
            let at = content.corners.get(*corner);
            *place = at.copied().map(Vector3::from).ok_or_else(|| {
                invalid(key, format!("triangle {index} names corner {corner}, which is not there"))
            })?;
        }
        Ok(places)
    };
    content.triangles.iter().enumerate().map(triangle).collect()
}
