//! Collision meshes of a URDF's links: read, made convex (parry), and touched at some points of the hull that lie far from each other.
//!
//! Files are STL, OBJ or COLLADA (crate mesh-loader). `package://NAME/PATH` is looked for in the folders above the URDF, as `NAME/PATH`,
//! as `PATH` in one that is called NAME, and as `PATH`; then in those of the environment's `ROS_PACKAGE_PATH`. Every other path begins at
//! the URDF. What cannot be read is passed over, and [`Robot::notes`] says why.

use std::path::{Path, PathBuf};

use mesh_loader::Loader;
use nalgebra::Vector3;
use nerd_core::contact::ContactPoint;
use nerd_core::robot::{MeshFile, Robot};
use parry3d_f64::transformation::try_convex_hull;

/// Largest file that is read (bytes).
const LARGEST: u64 = 1 << 28;
/// Radius of a point (m).
const SHARP: f64 = 1e-5;

/// Gives a robot that was read from the URDF `path` at most `points` contact points for each of its collision meshes; none where no
/// file is known.
pub fn touch(robot: &mut Robot, path: Option<&Path>, points: usize) {
    let Some(path) = path.filter(|_| points > 0) else { return };
    // Where a link into the folder of packages was followed, the packages are where it leads.
    let path = std::fs::canonicalize(path).unwrap_or_else(|_| path.into());
    for mesh in std::mem::take(&mut robot.meshes) {
        match vertices(&mesh, &path) {
            Ok(vertices) => {
                robot.contact_points.extend(spread(&hull(&vertices), points).into_iter().map(|at| ContactPoint {
                    link: mesh.link,
                    local: mesh.pose.transform_point(&at.into()).coords,
                    radius: SHARP,
                    thickness: SHARP,
                }));
                if let Some(k) = robot.skipped_meshes.iter().position(|name| *name == mesh.of) {
                    robot.skipped_meshes.remove(k);
                }
            }
            Err(reason) => robot.notes.push(format!("link `{}`: mesh {}: {reason}; nothing touches it", mesh.of, mesh.file)),
        }
    }
}

/// The vertices of a mesh in its own frame (m).
fn vertices(mesh: &MeshFile, urdf: &Path) -> Result<Vec<Vector3<f64>>, String> {
    let path = find(&mesh.file, urdf).ok_or("is not there")?;
    let size = std::fs::metadata(&path).map_err(|e| e.to_string())?.len();
    if size > LARGEST {
        return Err(format!("has {size} bytes, more than {LARGEST}"));
    }
    // A file that nobody could foresee ends in a line, too.
    let read = std::panic::catch_unwind(|| load(&path)).map_err(|_| "cannot be read".to_string())?;
    let scene = read.map_err(|e| e.to_string().split_whitespace().collect::<Vec<_>>().join(" "))?;
    let all = scene.meshes.iter().flat_map(|m| &m.vertices).map(|v| Vector3::from(v.map(f64::from)).component_mul(&mesh.scale));
    let all: Vec<Vector3<f64>> = all.collect();
    match all.iter().all(|v| v.iter().all(|x| x.abs() < 1e6)) {
        true if all.is_empty() => Err("has no vertex".into()),
        true => Ok(all),
        false => Err("has a vertex that is not finite, or absurdly far".into()),
    }
}

/// Binary STL may begin with the word that makes a text of it; its length tells which it is.
fn load(path: &Path) -> std::io::Result<mesh_loader::Scene> {
    if path.extension().is_some_and(|e| e.eq_ignore_ascii_case("stl")) {
        let mut bytes = std::fs::read(path)?;
        let count = bytes.get(80..84).and_then(|n| n.try_into().ok()).map_or(0, u32::from_le_bytes);
        if bytes.len() as u64 == 84 + 50 * u64::from(count) {
            bytes[..80].fill(0);
        }
        return mesh_loader::stl::from_slice(&bytes);
    }
    Loader::default().load(path)
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
    let told = std::env::var_os("ROS_PACKAGE_PATH").unwrap_or_default();
    let told: Vec<PathBuf> = std::env::split_paths(&told).collect();
    above.chain(told.iter().map(|folder| folder.join(name).join(rest))).find_map(there)
}

/// The vertices of the convex hull; all of them where there is none, since they lie in a plane.
fn hull(vertices: &[Vector3<f64>]) -> Vec<Vector3<f64>> {
    let points: Vec<_> = vertices.iter().map(|v| parry3d_f64::math::Vector::new(v.x, v.y, v.z)).collect();
    let made = std::panic::catch_unwind(|| try_convex_hull(&points).ok()).ok().flatten();
    made.map_or_else(|| vertices.to_vec(), |(hull, _)| hull.iter().map(|p| Vector3::new(p.x, p.y, p.z)).collect())
}

/// At most so many of the points: those that lie farthest towards the corners of the box around them, the lower ones first, then
/// always the one farthest from all that were taken. A sole with an ankle on it keeps the corners that it stands on.
fn spread(points: &[Vector3<f64>], most: usize) -> Vec<Vector3<f64>> {
    let Some(first) = points.first() else { return Vec::new() };
    let (least, largest) = points.iter().fold((*first, *first), |(a, b), p| (a.inf(p), b.sup(p)));
    // In units of the box, so that a flat one has eight corners, too.
    let unit = (largest - least).map(|x| if x > 0.0 { 1.0 / x } else { 0.0 });
    let mut taken: Vec<Vector3<f64>> = Vec::new();
    let mut away = vec![f64::INFINITY; points.len()];
    let mut take = |k: usize, taken: &mut Vec<Vector3<f64>>| {
        away.iter_mut().zip(points).for_each(|(d, p)| *d = d.min((p - points[k]).norm()));
        taken.push(points[k]);
        away.iter().copied().enumerate().max_by(|a, b| a.1.total_cmp(&b.1)).filter(|(_, far)| *far > 1e-6)
    };
    let mut next = None;
    for corner in 0..8 {
        let towards = Vector3::new(0, 1, 2).map(|axis| if corner >> axis & 1 == 0 { -1.0 } else { 1.0 }).component_mul(&unit);
        let far = |p: &Vector3<f64>| towards.dot(p);
        let Some(k) = (0..points.len()).max_by(|a, b| far(&points[*a]).total_cmp(&far(&points[*b]))) else { break };
        if taken.len() < most && taken.iter().all(|t| (t - points[k]).norm() > 1e-6) {
            next = take(k, &mut taken);
        }
    }
    while let Some((k, _)) = next.filter(|_| taken.len() < most) {
        next = take(k, &mut taken);
    }
    taken
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_of_a_sole_are_its_corners() {
        // A box of 0.2 x 0.1 x 0.02 m with points all over it.
        let steps = |n: i32| (0..=n).map(move |k| f64::from(k) / f64::from(n) - 0.5);
        let all: Vec<Vector3<f64>> =
            steps(8).flat_map(|x| steps(8).flat_map(move |y| steps(2).map(move |z| Vector3::new(0.2 * x, 0.1 * y, 0.02 * z)))).collect();
        let found = spread(&hull(&all), 8);
        assert_eq!(found.len(), 8);
        for p in found {
            let off = (p.abs() - Vector3::new(0.1, 0.05, 0.01)).amax();
            assert!(off < 1e-9, "{p} is {off:.1e} m from a corner");
        }
        // Of a point there is one.
        assert_eq!(spread(&[Vector3::x(); 5], 8).len(), 1);
    }
}
