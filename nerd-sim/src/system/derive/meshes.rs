//! Collision meshes of a URDF's links: read, made convex, and touched by few points, each the deepest of some vertices; by rims where they are
//! wheels.
//!
//! Files are STL (crate mesh-loader), OBJ, COLLADA, glTF (crate gltf) or PLY (crate serde-ply). `package://NAME/PATH` is looked for in the
//! folders above the URDF, as `NAME/PATH`, as `PATH` in one that is called NAME, and as `PATH`; then in those of the environment's
//! `ROS_PACKAGE_PATH`. Every other path begins at the URDF. What cannot be read is passed over, and a note says why.

use nerd_core::robot::Hull;
use serde::de::IgnoredAny;
use serde_ply::PlyReader;

use super::file::{MOST, bytes_of};
use super::hull::{allowance, few, hull};
use super::spread::{SHARP, endless, partition};
use super::{collada, gltf, wheel::wheel};
use crate::internal::*;

/// Share of the allowance within which a link's meshes reach as far as its file says.
const FINE: f64 = 0.2;

/// Gives a robot that was read from the URDF `path` at most `points` contact points for the collision meshes of each link; none where no
/// file is known. Of a wheel they are its rims.
pub fn touch(read: &mut UrdfRobot, path: Option<&Path>, points: usize) {
    let Some(path) = path.filter(|_| points > 0) else { return };
    // Where a link into the folder of packages was followed, the packages are where it leads.
    let path = std::fs::canonicalize(path).unwrap_or_else(|_| path.into());
    let UrdfRobot { robot, notes, meshes, hulls, .. } = read;
    let mut pools = BTreeMap::<usize, Vec<Vector3<f64>>>::new();
    meshes.retain(|mesh| match vertices(&mesh.file, &mesh.scale, &path) {
        Ok(vertices) => {
            let place = |v: Vector3<f64>| mesh.pose.transform_point(&v.into()).coords;
            let hull: Arc<[_]> = hull(&vertices).0.into_iter().map(place).collect();
            pools.entry(mesh.link).or_default().extend(hull.iter());
            hulls.push(Hull { link: mesh.link, vertices: hull });
            false
        }
        Err(reason) => {
            notes.push(format!("link `{}`: mesh {}: {reason}; nothing touches it", mesh.of, mesh.file));
            true
        }
    });
    for (link, all) in pools {
        let kept = few(&all, |_| f64::NEG_INFINITY, FINE * allowance(&all));
        let turning = robot.links[link].joint.as_ref().filter(|joint| endless(joint));
        let rolling = turning.and_then(|joint| wheel(link, joint, &kept));
        robot.contact_points.extend(rolling.unwrap_or_else(|| partition(link, &kept, &kept, SHARP, points)));
    }
}

/// The vertices of a mesh that a URDF names, in its own frame (m); lengths are multiplied along its axes.
pub(crate) fn vertices(file: &str, scale: &Vector3<f64>, urdf: &Path) -> Result<Vec<Vector3<f64>>, String> {
    if !scale.iter().all(|x| (1e-9..1e9).contains(&x.abs())) {
        return Err("has no usable scale".into());
    }
    let path = find(file, urdf).ok_or("is not there")?;
    let bytes = bytes_of(&path)?;
    // An unforeseen file ends in a line, too.
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

fn load(mut bytes: Vec<u8>, path: &Path) -> Result<Vec<Vector3<f64>>, String> {
    match path.extension().unwrap_or_default().to_string_lossy().to_lowercase().as_str() {
        "stl" => {
            // Binary STL may begin with the word that makes a text of it; its length tells which it is.
            let count = bytes.get(80..84).and_then(|n| n.try_into().ok()).map_or(0, u32::from_le_bytes);
            if bytes.len() as u64 == 84 + 50 * u64::from(count) {
                bytes[..80].fill(0);
            }
            let scene = mesh_loader::stl::from_slice(&bytes).map_err(|e| e.to_string())?;
            Ok(scene.meshes.iter().flat_map(|m| &m.vertices).map(|v| Vector3::from(v.map(f64::from))).collect())
        }
        // A hull has no use for faces, whose kinds may be mixed.
        "obj" => {
            let text = String::from_utf8_lossy(&bytes);
            let lines = text.lines().enumerate().filter(|(_, line)| line.trim_start().starts_with("v "));
            let vertex = |(n, line): (usize, &str)| {
                let xyz: Vec<f64> = line.split_whitespace().skip(1).take(3).filter_map(|x| x.parse().ok()).collect();
                (xyz.len() == 3).then(|| Vector3::from_column_slice(&xyz)).ok_or(format!("line {}: a vertex needs three numbers", n + 1))
            };
            lines.map(vertex).collect()
        }
        "dae" => collada::vertices(&String::from_utf8_lossy(&bytes)),
        "gltf" | "glb" => gltf::vertices(&bytes, path),
        "ply" => ply(&bytes),
        other => Err(format!("is of a kind (.{other}) that is not read; STL, OBJ, COLLADA (.dae), glTF (.gltf, .glb) and PLY are")),
    }
}

/// The vertices of a PLY file, which may hold them after other things.
fn ply(bytes: &[u8]) -> Result<Vec<Vector3<f64>>, String> {
    #[derive(Deserialize)]
    struct Vertex {
        x: f64,
        y: f64,
        z: f64,
    }
    let mut reader = PlyReader::from_reader(bytes).map_err(|e| format!("is no PLY that can be read: {e}"))?;
    while let Some(element) = reader.current_element() {
        let (name, count) = (element.name.clone(), element.count);
        if count > MOST {
            return Err(format!("more than {MOST} of `{name}`"));
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

/// The file that a URDF's text means.
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
