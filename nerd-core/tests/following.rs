//! Joints that follow others: the dynamics are those of all joints by themselves, folded into the coordinates.

mod common;

use common::*;
use nalgebra::{DMatrix, DVector, Vector3};
use nerd_core::dynamics::*;
use nerd_core::robot::Robot;

const GRAVITY: Vector3<f64> = Vector3::new(0.3, -0.5, -9.81);

/// The robot whose joints all move by themselves, and `G` and `o` of `q_all = G q + o` (rates alike, without o).
fn unfolded(robot: &Robot) -> (Robot, DMatrix<f64>, DVector<f64>) {
    let mut all = robot.clone();
    (0..all.links.len()).for_each(|link| all.follow(link, None));
    let (mut g, mut o) = (DMatrix::zeros(all.nv(), robot.nv()), DVector::zeros(all.nv()));
    (0..robot.root_dofs()).for_each(|k| g[(k, k)] = 1.0);
    for (link, (one, many)) in robot.links.iter().zip(robot.dofs().into_iter().zip(all.dofs())) {
        let Some(joint) = &link.joint else { continue };
        g[(many, one)] = joint.ratio();
        o[many] = joint.mimic().map_or(0.0, |m| m.offset);
    }
    (all, g, o)
}

fn off(a: &DMatrix<f64>, b: &DMatrix<f64>) -> f64 {
    (a - b).amax() / b.amax().max(1e-12)
}

#[test]
fn the_dynamics_are_those_of_all_joints_folded() {
    let mut followers = 0;
    for (robot, mut rng) in robots() {
        let robot = following(&mut rng, &robot);
        let (all, g, o) = unfolded(&robot);
        followers += all.nv() - robot.nv();
        let (q, qd) = state(&mut rng, &robot);
        let qdd = values(&mut rng, robot.nv(), 2.0);
        let joints = g.view((robot.root_dofs(), robot.root_dofs()), (all.joint_count(), robot.joint_count()))
            * DVector::from_column_slice(&q[robot.root_coords()..])
            + o.rows(robot.root_dofs(), all.joint_count());
        let q_all = [&q[..robot.root_coords()], joints.as_slice()].concat();
        let spread = |x: &[f64]| &g * DVector::from_column_slice(x);
        let (mut one, mut many) = (Data::new(&robot), Data::new(&all));
        push(&mut rng, &mut one);
        many.external = one.external.clone();
        kinematics(&robot, &q, &mut one);
        kinematics(&all, &q_all, &mut many);
        rnea(&robot, &qd, &qdd, &GRAVITY, &mut one);
        rnea(&all, spread(&qd).as_slice(), spread(&qdd).as_slice(), &GRAVITY, &mut many);
        let folded = g.transpose() * &many.tau;
        let apart = (&one.tau - &folded).amax() / folded.amax();
        assert!(apart < 1e-12, "inverse dynamics of {} coordinates: {apart:.1e} off", robot.nv());
        let tau = one.tau.clone();
        crba(&robot, &mut one);
        crba(&all, &mut many);
        let apart = off(&one.mass, &(g.transpose() * &many.mass * &g));
        assert!(apart < 1e-12, "mass matrix: {apart:.1e} off");
        // Forward dynamics undo inverse dynamics.
        assert!(aba(&robot, &qd, tau.as_slice(), &GRAVITY, &mut one));
        let apart = one.qdd.iter().zip(&qdd).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(apart < 1e-8, "forward dynamics of {} coordinates: {apart:.1e} off", robot.nv());
        let (state, state_all) = ([q.as_slice(), &qd].concat(), [q_all.as_slice(), spread(&qd).as_slice()].concat());
        let (a, b) = (totals(&robot, &state, &mut one), totals(&all, &state_all, &mut many));
        assert!((a.kinetic - b.kinetic).abs() < 1e-10 * b.kinetic, "kinetic energy {} J, of all joints {} J", a.kinetic, b.kinetic);
    }
    assert!(followers > 40, "{followers} joints that follow");
}

#[test]
fn a_urdf_says_what_follows_what() {
    let text = |mimics: &str| {
        let link = |name: &str| {
            format!(
                r#"<link name="{name}"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>"#
            )
        };
        let joint = |name: &str, parent: &str, child: &str, inner: &str| {
            format!(
                r#"<joint name="{name}" type="continuous"><parent link="{parent}"/><child link="{child}"/><axis xyz="0 0 1"/><dynamics damping="0.5" friction="0.1"/>{inner}</joint>"#
            )
        };
        let [b, c] = [mimics.split('|').next().unwrap_or_default(), mimics.split('|').nth(1).unwrap_or_default()];
        let links: String = ["base", "a", "b", "c"].map(link).concat();
        format!(
            r#"<robot name="r">{links}{}{}{}</robot>"#,
            joint("ja", "base", "a", ""),
            joint("jb", "a", "b", b),
            joint("jc", "base", "c", c)
        )
    };
    // c follows b, which follows a: 3 (2 q + 0.1) - 0.2.
    let chain = r#"<mimic joint="ja" multiplier="2" offset="0.1"/>|<mimic joint="jb" multiplier="3" offset="-0.2"/>"#;
    let robot = Robot::from_urdf(&text(chain), false).expect("a robot");
    assert_eq!((robot.nq(), robot.joint_count(), robot.links.len()), (1, 1, 3));
    let c = robot.links[2].joint.as_ref().and_then(|j| j.mimic().copied()).expect("it follows");
    assert!((c.multiplier - 6.0).abs() < 1e-12 && (c.offset - 0.1).abs() < 1e-12 && c.coordinate == 0, "{c:?}");
    // Dampers act at what they brake: 0.5 (1 + 2^2 + 6^2), dry friction 0.1 (1 + 2 + 6).
    let a = robot.joints().next().expect("a joint");
    assert!((a.damping - 20.5).abs() < 1e-12 && (a.friction - 0.9).abs() < 1e-12, "{} and {}", a.damping, a.friction);
    // Whole multiples know no turns; others must.
    assert!(a.wraps());
    let half = Robot::from_urdf(&text(r#"<mimic joint="ja" multiplier="0.5"/>|"#), false).expect("a robot");
    assert!(!half.joints().next().expect("a joint").wraps());
    // What is not there cannot be followed.
    let alone = Robot::from_urdf(&text(r#"<mimic joint="nobody"/>|"#), false).expect("a robot");
    assert_eq!(alone.joint_count(), 3);
    assert!(alone.notes[0].contains("joint `jb`: <mimic> of `nobody`, which is not there"), "{:?}", alone.notes);
    for (mimics, said) in [
        (r#"<mimic joint="jc"/>|<mimic joint="jb"/>"#, "leads back to itself"),
        (r#"<mimic joint="jb"/>|"#, "leads back to itself"),
        (r#"<mimic joint="ja" multiplier="NaN"/>|"#, "not finite"),
        (r#"<mimic joint="ja" multiplier="1e99"/>|"#, "absurd"),
    ] {
        let error = Robot::from_urdf(&text(mimics), false).expect_err("a refusal").to_string();
        assert!(error.contains(said) && !error.contains('\n'), "`{error}` does not say `{said}`");
    }
}
