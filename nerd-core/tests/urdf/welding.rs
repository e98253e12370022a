//! Fixed joints are lumped exactly: the robot read from a URDF equals the robot computed by hand. Also the order of
//! links, joints and contact points.
//!
//! Tolerance: the same sums in another order, so rounding only: 1e-13 of the largest entry.

use super::common::*;
use nerd_core::robot::ShapeKind;

fn triple(v: &[f64]) -> String {
    format!("{:?} {:?} {:?}", v[0], v[1], v[2])
}

/// A random pose as `<origin>`, rotation and position.
fn origin(rng: &mut Rng) -> (String, Matrix3<f64>, Vector3<f64>) {
    let (x, angles) = (vector3(rng, 0.5), vector3(rng, 1.5));
    (format!(r#"<origin xyz="{}" rpy="{}"/>"#, triple(x.as_slice()), triple(angles.as_slice())), rpy(angles.into()), x)
}

fn massive(name: &str, origin: &str, b: &BodyInertia) -> String {
    let i = b.inertia;
    format!(
        r#"<link name="{name}"><inertial>{origin}<mass value="{:?}"/><inertia ixx="{:?}" ixy="{:?}" ixz="{:?}" iyy="{:?}" iyz="{:?}" izz="{:?}"/></inertial></link>"#,
        b.mass, i.m11, i.m12, i.m13, i.m22, i.m23, i.m33
    )
}

/// First principles: sum of masses, of first moments, and of second moments about `about`.
fn total(
    parts: &[(BodyInertia, Matrix3<f64>, Vector3<f64>)],
    about: &Vector3<f64>,
) -> (f64, Vector3<f64>, Matrix3<f64>) {
    parts.iter().fold((0.0, Vector3::zeros(), Matrix3::zeros()), |(mass, moment, inertia), (b, r, x)| {
        let c = r * b.com + x;
        let d = c - about;
        let steiner = Matrix3::from_fn(|i, j| b.mass * (if i == j { d.norm_squared() } else { 0.0 } - d[i] * d[j]));
        (mass + b.mass, moment + b.mass * c, inertia + r * b.inertia * r.transpose() + steiner)
    })
}

#[test]
fn fixed_links_are_welded_on_exactly() {
    let mut worst = 0.0f64;
    for seed in 0..50 {
        let mut rng = Rng::seed_from_u64(seed);
        // base =fixed= arm =fixed= tool, and a moving wheel on the tool, its inertia rotated in its link.
        let bodies: [BodyInertia; 4] = std::array::from_fn(|_| BodyInertia { com: Vector3::zeros(), ..body(&mut rng) });
        let centres: [_; 4] = std::array::from_fn(|_| origin(&mut rng));
        let joints: [_; 3] = std::array::from_fn(|_| origin(&mut rng));
        let names = ["base", "arm", "tool", "wheel"];
        let mut text = String::from(r#"<robot name="r">"#);
        for k in 0..4 {
            text += &massive(names[k], &centres[k].0, &bodies[k]);
        }
        for k in 0..3 {
            let kind = if k == 2 { "continuous" } else { "fixed" };
            text += &joint(
                &format!("j{k}"),
                kind,
                names[k],
                names[k + 1],
                &format!("{}<axis xyz=\"1 2 3\"/>", joints[k].0),
            );
        }
        text += "</robot>";
        let robot = Robot::from_urdf(&text, Base::Floating).expect("valid");
        assert_eq!(robot.links.iter().map(|l| &l.name).collect::<Vec<_>>(), ["base", "wheel"]);

        let (mut r, mut x, mut parts) = (Matrix3::identity(), Vector3::zeros(), Vec::new());
        for k in 0..3 {
            parts.push((bodies[k], r * centres[k].1, r * centres[k].2 + x));
            (x, r) = (r * joints[k].2 + x, r * joints[k].1);
        }
        let com = total(&parts, &Vector3::zeros()).1 / parts.iter().map(|p| p.0.mass).sum::<f64>();
        let (mass, _, inertia) = total(&parts, &com);
        let read = robot.links[0].inertia;
        worst = worst.max((read.mass - mass).abs()).max(gap(read.com.as_slice(), com.as_slice()));
        worst = worst.max(gap(read.inertia.as_slice(), inertia.as_slice()));
        let place = robot.links[1].joint.as_ref().expect("moves").origin();
        worst = worst.max(gap(place.rotation.to_rotation_matrix().matrix().as_slice(), r.as_slice()));
        worst = worst.max(gap(place.translation.vector.as_slice(), x.as_slice()));
        // The wheel alone: its inertia rotated by rpy about its centre of mass.
        let turned = centres[3].1 * bodies[3].inertia * centres[3].1.transpose();
        worst = worst.max(gap(robot.links[1].inertia.inertia.as_slice(), turned.as_slice()));
    }
    assert!(worst < 1e-13, "the welded robot is off by {worst:.1e}, allowed 1e-13");
}

#[test]
fn links_come_depth_first_in_the_order_of_the_joints() {
    let links: String = ["z", "a", "b", "c", "d", "e"].iter().map(|n| format!(r#"<link name="{n}"/>"#)).collect();
    let joints: String = [("z", "b"), ("c", "d"), ("z", "a"), ("b", "c"), ("b", "e")]
        .iter()
        .map(|(p, c)| joint(&format!("to_{c}"), "continuous", p, c, ""))
        .collect();
    let text = format!(r#"<robot name="r">{links}{joints}</robot>"#);
    let fixed = Robot::from_urdf(&text, Base::fixed()).expect("valid");
    assert_eq!(fixed.joints().map(|j| j.name.as_str()).collect::<Vec<_>>(), ["to_b", "to_c", "to_d", "to_e", "to_a"]);
    assert_eq!(fixed.links.iter().map(|l| l.parent).collect::<Vec<_>>(), [None, Some(0), Some(1), Some(0), None]);
    let floating = Robot::from_urdf(&text, Base::Floating).expect("valid");
    assert_eq!(
        floating.links.iter().map(|l| l.parent).collect::<Vec<_>>(),
        [None, Some(0), Some(1), Some(2), Some(1), Some(0)]
    );
}

#[test]
fn shapes_of_fixed_links_are_carried_over_and_meshes_reported() {
    let shape = |inner: &str| format!(r#"<collision><origin xyz="0 0 1"/><geometry>{inner}</geometry></collision>"#);
    let text = format!(
        r#"<robot name="r"><link name="base">{}</link><link name="tip">{}{}{}{}</link>{}</robot>"#,
        shape(r#"<mesh filename="m.stl"/>"#),
        shape(r#"<sphere radius="0.3"/>"#),
        shape(r#"<box size="2 4 6"/>"#),
        shape(r#"<cylinder radius="0.1" length="2"/>"#),
        shape(r#"<mesh filename="m.stl"/>"#),
        joint("weld", "fixed", "base", "tip", r#"<origin xyz="10 0 0" rpy="0 0 1.5707963267948966"/>"#),
    );
    let UrdfRobot { robot, meshes, .. } = UrdfRobot::read(&text, Base::Floating).expect("valid");
    assert_eq!(
        meshes.iter().map(|m| (m.of.as_str(), m.file.as_str())).collect::<Vec<_>>(),
        [("base", "m.stl"), ("tip", "m.stl")]
    );
    assert_eq!(robot.links[0].shapes[1].kind, ShapeKind::Box { half: Vector3::new(1.0, 2.0, 3.0) });
    let points: Vec<_> = robot.contact_points.iter().map(|p| (p.local, p.radius, p.thickness)).collect();
    let mut expected = vec![(Vector3::new(10.0, 0.0, 1.0), 0.3)];
    for c in [[-1, -2, -3], [1, -2, -3], [-1, 2, -3], [1, 2, -3], [-1, -2, 3], [1, -2, 3], [-1, 2, 3], [1, 2, 3]] {
        // Rotated by 90 degrees about z: (x, y) to (-y, x).
        expected.push((Vector3::new(10.0 - f64::from(c[1]), f64::from(c[0]), 1.0 + f64::from(c[2])), 1e-5));
    }
    // Three points on each rim of a cylinder.
    expected.extend([2.0, 2.0, 2.0, 0.0, 0.0, 0.0].map(|z| (Vector3::new(10.0, 0.0, z), 1e-5)));
    assert_eq!(points.len(), expected.len());
    for ((at, radius, thickness), (place, r)) in points.into_iter().zip(expected) {
        assert!(
            (at - place).norm() < 1e-14 && radius == r && thickness == r,
            "{at} radius {radius}, expected {place} radius {r}"
        );
    }
}

#[test]
fn spreading_a_box_along_itself_makes_it_longer() {
    // A box of 1 kg, edges a, b, c, has second moments a^2 / 12, ...; twice the length along x gives four times the
    // first.
    let of = |a: f64, b: f64, c: f64| {
        Matrix3::from_diagonal(&(Vector3::new(b * b + c * c, a * a + c * c, a * a + b * b) / 12.0))
    };
    let mut body = BodyInertia { mass: 1.0, com: Vector3::zeros(), inertia: of(0.3, 0.2, 0.1) };
    body.spread(0, 4.0);
    assert!((body.inertia - of(0.6, 0.2, 0.1)).norm() < 1e-15, "{} is not that of the longer box", body.inertia);
}
