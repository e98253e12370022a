//! Reads the vertices of the meshes that a robot's file names.
//!
//! Formats are STL (crate mesh-loader), OBJ, COLLADA, glTF (crate gltf) and PLY (crate serde-ply).
//! `package://NAME/PATH` is searched in the folders above the URDF, as `NAME/PATH`, as `PATH` in a folder called NAME,
//! and as `PATH`. Then come the folders of the environment variable `ROS_PACKAGE_PATH`. Every other path is relative to
//! the URDF.

use serde::de::IgnoredAny;
use serde_ply::PlyReader;

use super::{collada, gltf};
use crate::internal::*;
use crate::robots::mesh::file::{MAX_VERTICES, bytes_of};
use crate::robots::mesh::stl;

/// Vertices of the mesh `file` named by a URDF, in the mesh's own frame (m), scaled along its axes by `scale`.
pub(crate) fn vertices(file: &str, scale: &Vector3<f64>, urdf: &Path) -> Result<Vec<Vector3<f64>>, String> {
    if !scale.iter().all(|x| (1e-9..1e9).contains(&x.abs())) {
        return Err("has no usable scale".into());
    }
    let path = find(file, urdf).ok_or("is not there")?;
    let bytes = bytes_of(&path)?;
    // A reader's panic also becomes an error.
    let read = std::panic::catch_unwind(|| load(bytes, &path)).map_err(|_| "cannot be read".to_string())?;
    let read = read.map_err(|e| e.split_whitespace().collect::<Vec<_>>().join(" "))?;
    let all: Vec<Vector3<f64>> = read.into_iter().map(|v| v.component_mul(scale)).collect();
    match all.iter().all(|v| v.iter().all(|x| x.abs() < 1e6)) {
        true if all.is_empty() => Err("has no vertex".into()),
        true if all.iter().all(|v| v == &all[0]) => Err("has no size".into()),
        true => Ok(all),
        false => Err("has a vertex that is not finite, or absurdly far".into()),
    }
}

fn load(bytes: Vec<u8>, path: &Path) -> Result<Vec<Vector3<f64>>, String> {
    match path.extension().unwrap_or_default().to_string_lossy().to_lowercase().as_str() {
        "stl" => Ok(stl(bytes)?.0),
        // Faces are ignored: a convex hull needs only vertices, and faces may be of mixed kinds.
        "obj" => {
            let text = String::from_utf8_lossy(&bytes);
            let lines = text.lines().enumerate().filter(|(_, line)| line.trim_start().starts_with("v "));
            let vertex = |(n, line): (usize, &str)| {
                let xyz: Vec<f64> = line.split_whitespace().skip(1).take(3).filter_map(|x| x.parse().ok()).collect();
                (xyz.len() == 3)
                    .then(|| Vector3::from_column_slice(&xyz))
                    .ok_or(format!("line {}: a vertex needs three numbers", n + 1))
            };
            lines.map(vertex).collect()
        }
        "dae" => collada::vertices(&String::from_utf8_lossy(&bytes)),
        "gltf" | "glb" => gltf::vertices(&bytes, path),
        "ply" => ply(&bytes),
        other => Err(format!(
            "is of a kind (.{other}) that is not read; STL, OBJ, COLLADA (.dae), glTF (.gltf, .glb) and PLY are"
        )),
    }
}

/// The vertices of a PLY file; other elements before them are skipped.
fn ply(bytes: &[u8]) -> Result<Vec<Vector3<f64>>, String> {
    #[derive(Deserialize)]
    struct Vertex {
        x: f64,
        y: f64,
        z: f64,
    }
    let mut reader = PlyReader::from_reader(bytes).map_err(|e| format!("is no PLY that can be read: {e}"))?;
    while let Some(element) = reader.current_element() {
        let name = element.name.clone();
        let count = element.count;
        if count > MAX_VERTICES {
            return Err(format!("more than {MAX_VERTICES} of `{name}`"));
        }
        let wrong = |e: serde_ply::DeserializeError| format!("{name}: {e}");
        if name == "vertex" {
            let all: Vec<Vertex> = reader.next_element().map_err(wrong)?;
            return Ok(all.iter().map(|v| Vector3::new(v.x, v.y, v.z)).collect());
        }
        reader.next_element::<Vec<BTreeMap<String, IgnoredAny>>>().map_err(wrong)?;
    }
    Ok(Vec::new())
}

/// Path of the mesh `file` that a URDF refers to.
fn find(file: &str, urdf: &Path) -> Option<PathBuf> {
    let there = |path: PathBuf| path.is_file().then_some(path);
    let Some(package) = file.strip_prefix("package://") else {
        return there(urdf.parent()?.join(file.strip_prefix("file://").unwrap_or(file)));
    };
    let (name, rest) = package.split_once('/')?;
    let above = urdf.ancestors().skip(1).flat_map(|folder| {
        let own = folder.file_name().is_some_and(|own| own == name).then(|| folder.join(rest));
        [Some(folder.join(name).join(rest)), own, Some(folder.join(rest))].into_iter().flatten()
    });
    let packages = std::env::var_os("ROS_PACKAGE_PATH").unwrap_or_default();
    let packages: Vec<PathBuf> = std::env::split_paths(&packages).collect();
    above.chain(packages.iter().map(|folder| folder.join(name).join(rest))).find_map(there)
}
