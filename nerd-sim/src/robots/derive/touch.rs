//! Contact points of collision meshes. Each mesh becomes its convex hull with few contact points, each the deepest of a
//! group of vertices. Wheels get rims.

use nerd_core::robot::Hull;

use super::spread::{SHARP_RADIUS, endless, partition};
use super::{vertices, wheel::wheel};
use crate::internal::*;
use crate::robots::mesh::hull::{corners, hull};

/// Adds contact points to a robot read from the file `path`. Collision meshes and hulls of a link that share a surface
/// get at most `points`; meshes are skipped if `path` is unknown. A wheel gets rims.
pub(crate) fn touch(read: &mut UrdfRobot, path: Option<&Path>, points: usize) {
    let UrdfRobot { robot, notes, meshes, hulls, .. } = read;
    if points == 0 {
        hulls.clear();
        return;
    }
    hulls.iter_mut().for_each(|own| own.vertices = hull(&own.vertices).0.into());
    // Resolve symbolic links: packages are in the folders of the link's target.
    let path = path.map(|path| std::fs::canonicalize(path).unwrap_or_else(|_| path.into()));
    meshes.retain(|mesh| match path.as_deref().map(|path| vertices(&mesh.file, &mesh.scale, path)) {
        Some(Ok(vertices)) => {
            let place = |v: Vector3<f64>| mesh.pose.transform_point(&v.into()).coords;
            hulls.push(Hull {
                link: mesh.link,
                vertices: hull(&vertices).0.into_iter().map(place).collect(),
                surface: mesh.surface,
            });
            false
        }
        Some(Err(reason)) => {
            notes.push(format!("link `{}`: mesh {}: {reason}; nothing touches it", mesh.of, mesh.file));
            true
        }
        None => true,
    });
    let mut pools = BTreeMap::<(usize, Option<usize>), Vec<Vector3<f64>>>::new();
    hulls.iter().for_each(|hull| pools.entry((hull.link, hull.surface)).or_default().extend(hull.vertices.iter()));
    for ((link, surface), all) in pools {
        let kept = corners(&all);
        let turning = robot.links[link].joint.as_ref().filter(|joint| endless(joint));
        let rolling = turning.and_then(|joint| wheel(link, joint, &kept));
        let own = rolling.unwrap_or_else(|| partition(link, &kept, &kept, SHARP_RADIUS, points));
        robot.contact_points.extend(own.into_iter().map(|point| point.on(surface)));
    }
}

#[cfg(test)]
mod tests {
    use nerd_core::robot::{Bodies, Form, Solid};

    use super::*;
    use crate::robots::derive::{listed, plain, spread::enough};
    use crate::robots::world::World;
    use crate::system::Source;

    /// A cube of 0.2 m centred on its body's frame, 0.4 m below its joint, as two hulls of different surfaces: lower
    /// and upper half.
    fn cube() -> UrdfRobot {
        let text = "<robot name=\"cube\"><link name=\"base\"/><link name=\"cube\"><inertial><mass value=\"1\"/><inertia ixx=\".01\" \
                    iyy=\".01\" izz=\".01\" ixy=\"0\" ixz=\"0\" iyz=\"0\"/></inertial></link><joint name=\"slide\" type=\"prismatic\"><parent \
                    link=\"base\"/><child link=\"cube\"/><axis xyz=\"0 0 1\"/><limit lower=\"-1\" upper=\"1\" effort=\"9\" velocity=\"9\"/></joint></robot>";
        let (mut bodies, _) = Bodies::from_urdf(text).expect("bodies");
        let half = |low: f64, surface: usize| {
            let corner = |k: usize| {
                Vector3::new(0.2 * (k & 1) as f64 - 0.1, 0.1 * (k & 2) as f64 - 0.1, low + 0.025 * (k & 4) as f64)
            };
            let form = Form::Hull((0..8).map(corner).chain([Vector3::new(0.0, 0.0, low + 0.05)]).collect());
            Solid { pose: Isometry3::translation(0.0, 0.0, -0.4), form, surface: Some(surface) }
        };
        bodies.bodies[1].collisions = vec![half(-0.1, 2), half(0.0, 5)];
        bodies.bodies[1].frame = Isometry3::translation(0.0, 0.0, -0.4);
        UrdfRobot::of(&bodies, Base::fixed()).expect("a robot")
    }

    #[test]
    fn hulls_of_several_surfaces_touch_with_each() {
        let mut read = cube();
        touch(&mut read, None, 8);
        let of = |points: &[ContactPoint], surface: usize| -> Vec<f64> {
            points.iter().filter(|p| p.surface == Some(surface)).flat_map(|p| p.places()).map(|at| at.z).collect()
        };
        let extent = |heights: &[f64]| {
            [heights.iter().copied().fold(f64::MAX, f64::min), heights.iter().copied().fold(f64::MIN, f64::max)]
        };
        // A vertex inside a hull is not a vertex of the hull.
        assert!(read.hulls.iter().all(|hull| hull.vertices.len() == 8));
        let (few, _) = enough(&read.robot, &read.robot.zero_state());
        for points in [&read.robot.contact_points, &few] {
            for (surface, expected) in [(2, [-0.5, -0.4]), (5, [-0.4, -0.3])] {
                let found = extent(&of(points, surface));
                assert!(
                    (found[0] - expected[0]).abs() + (found[1] - expected[1]).abs() < 1e-12,
                    "surface {surface}: {found:?}, not {expected:?}"
                );
            }
            assert!(points.iter().all(|p| p.surface.is_some()));
        }
        let mut skipped = cube();
        touch(&mut skipped, None, 0);
        assert!(skipped.hulls.is_empty() && skipped.robot.contact_points.is_empty());
    }

    /// Points listed in a TOML are in the body's frame, 0.4 m below the joint; a point of the file keeps its surface.
    #[test]
    fn listed_points_count_from_the_frame_of_the_body() {
        let mut read = cube();
        touch(&mut read, None, 8);
        let own = read.robot.contact_points.clone();
        let contacts = listed(&read.robot);
        let lowest = contacts.iter().filter_map(|c| c.point).map(|at| at[2]).fold(f64::MAX, f64::min);
        assert!((lowest + 0.1).abs() < 1e-12, "the lowest corner is listed at {lowest} m, not at -0.1 m");
        let another = crate::system::ContactSpec { point: Some([0.0, 0.0, -0.2]), ..contacts[0].clone() };
        let spec = Spec { contacts: [contacts, vec![another]].concat(), ..plain(&read.robot) };
        let system = System::new("cube", read, World::default(), spec, Source::Derived).expect("a system");
        let (last, others) = system.robot.contact_points.split_last().expect("points");
        assert!(last.surface.is_none() && (last.local.z + 0.6).abs() < 1e-12, "{last:?} is not 0.6 m below the joint");
        assert_eq!(others.len(), own.len());
        for (a, b) in others.iter().zip(&own) {
            assert!((a.local - b.local).norm() < 1e-12 && a.surface == b.surface, "{a:?} was {b:?}");
        }
    }
}
