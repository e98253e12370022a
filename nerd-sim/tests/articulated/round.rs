//! Round shapes are round: a wheel rolls, a coin precesses at its rate, a cart keeps its speed, a can stands, lies and tips.

use std::f64::consts::{FRAC_PI_2, PI};
use std::sync::Arc;

use nalgebra::{UnitQuaternion, Vector3};
use nerd_core::state::{quaternion, vector};
use nerd_sim::prelude::*;
use nerd_sim::suite::bodies::{Body, UPRIGHT};

/// States after each of some frames on the ground with the given number of substeps.
fn roll(system: &Arc<System>, start: &[f64], frames: usize, substeps: usize) -> Vec<Vec<f64>> {
    let mut batch = Batch::new(system, &system.scene("ground").expect("ground"), 1);
    batch.reset(0, start);
    let mut solver = Articulated::new(ArticulatedConfig::implicit(substeps, Friction::Coulomb));
    let mut step = || {
        solver.step(&mut batch, &[]).expect("finite");
        batch.state(0).to_vec()
    };
    (0..frames).map(|_| step()).collect()
}

/// A cylinder along z of this radius and length (m), 1 kg, of even density.
fn cylinder(radius: f64, length: f64, material: [f64; 4]) -> Arc<System> {
    let (along, across) = (0.5 * radius * radius, radius * radius / 4.0 + length * length / 12.0);
    let shape = format!(r#"<cylinder radius="{radius}" length="{length}"/>"#);
    Body { shape, inertia: [across, across, along], material, ..Default::default() }.system().expect("a cylinder")
}

fn angles(q: &UnitQuaternion<f64>) -> [f64; 4] {
    q.coords.into()
}

/// The centre's velocity.
fn speed(state: &[f64]) -> Vector3<f64> {
    vector(&state[10..13]) + vector(&state[7..10]).cross(&vector(state))
}

#[test]
fn a_wheel_rolls_on() {
    let (radius, k) = (0.1, 1e4);
    let system = cylinder(radius, 0.04, [k, 100.0, 1e3, 0.5]);
    let sunk = 9.81 / (2.0 * k);
    let lying = angles(&UnitQuaternion::from_axis_angle(&Vector3::x_axis(), FRAC_PI_2));
    for substeps in [1, 4, 8, 32] {
        let height = radius - sunk + 1e-5;
        let start = Body::state([0.0, 0.0, height], lying, [0.0, 1.0 / radius, 0.0], [1.0, 0.0, 0.0]);
        let states = roll(&system, &start, 300, substeps);
        let last = &states[299];
        let high = states.iter().map(|s| (s[2] - height).abs()).fold(0.0, f64::max);
        let what = format!("{substeps} substeps: {} m in 5 s at 1 m/s, height off by {high:.1e} m, aside {:.1e} m", last[0], last[1]);
        println!("{what}");
        assert!((last[0] / 5.0 - 1.0).abs() < 1e-4 && last[1].abs() < 0.01 && high < 1e-4, "{what}");
    }
}

/// A coin that wobbles about its resting centre, its plane at angle a from the ground, precesses at `W^2 = 4 g / (R sin a)`
/// (Moffatt, Nature 404, 2000, without his viscosity).
#[test]
fn a_coin_precesses_at_its_rate() {
    let (radius, tilt, k) = (0.1, PI / 6.0, 1e5);
    let urdf = format!(
        r#"<robot name="coin"><link name="coin"><inertial><mass value="1"/><inertia ixx="{t}" ixy="0" ixz="0" iyy="{t}" iyz="0" izz="{a}"/></inertial></link></robot>"#,
        t = radius * radius / 4.0,
        a = radius * radius / 2.0
    );
    let toml = format!(
        "urdf = \"\"\nfloating = true\nframe_time = \"1/60\"\ngravity = [0.0, 0.0, -9.81]\nsubsteps = 8\n\
         material = {{ stiffness = {k:?}, damping = 100.0, friction_damping = 1e4, friction = 0.5 }}\n\
         [[scene]]\nname = \"ground\"\nplane = {{ height = 0.0, angles = [0.0, 0.0, 0.0] }}\n\
         [[contact]]\nlink = \"coin\"\npoint = [0.0, 0.0, 0.0]\naxis = [0.0, 0.0, 1.0]\nrim = {radius}\n"
    );
    let system = Arc::new(System::from_text("coin", &urdf, Some(&toml)).expect("a coin"));
    let rate = (4.0 * 9.81 / (radius * tilt.sin())).sqrt();
    let turned = UnitQuaternion::from_axis_angle(&Vector3::y_axis(), tilt);
    // About the diameter through the touching place.
    let spin = Vector3::new(-tilt.cos(), 0.0, tilt.sin()) * rate * tilt.sin();
    let height = radius * tilt.sin() + 1e-5 - 9.81 / k;
    let start = Body::state([0.0, 0.0, height], angles(&turned), spin.into(), [0.0; 3]);
    for substeps in [8, 16, 64] {
        let (mut turned, mut before) = (0.0, 0.0f64);
        let states = roll(&system, &start, 300, substeps);
        for state in &states {
            let axis = quaternion(&state[3..7]) * Vector3::z();
            let now = axis.y.atan2(axis.x);
            turned += (now - before + PI).rem_euclid(2.0 * PI) - PI;
            before = now;
        }
        let leans = (quaternion(&states[299][3..7]) * Vector3::z()).angle(&Vector3::z());
        let what =
            format!("{substeps} substeps: {:.4} rad/s, {rate:.4} by theory; leans {leans:.4} rad of {tilt:.4} after 5 s", turned / 5.0);
        println!("{what}");
        assert!((turned / 5.0 / rate - 1.0).abs() < 0.002, "{what}");
    }
}

#[test]
fn a_cart_keeps_its_speed() {
    let wheel = |x: f64, y: f64, n: usize| {
        format!(
            r#"<link name="w{n}"><inertial><mass value="0.5"/><inertia ixx="0.0013" ixy="0" ixz="0" iyy="0.0025" iyz="0" izz="0.0013"/></inertial><collision><origin rpy="1.5707963267948966 0 0"/><geometry><cylinder radius="0.1" length="0.04"/></geometry></collision></link><joint name="j{n}" type="continuous"><parent link="cart"/><child link="w{n}"/><origin xyz="{x} {y} 0"/><axis xyz="0 1 0"/></joint>"#
        )
    };
    let wheels: String =
        [(0.3, 0.2), (0.3, -0.2), (-0.3, 0.2), (-0.3, -0.2)].iter().enumerate().map(|(n, (x, y))| wheel(*x, *y, n)).collect();
    let urdf = format!(
        r#"<robot name="cart"><link name="cart"><inertial><mass value="10"/><inertia ixx="0.2" ixy="0" ixz="0" iyy="0.4" iyz="0" izz="0.5"/></inertial></link>{wheels}</robot>"#
    );
    let system = Arc::new(System::from_text("cart", &urdf, Some("like = \"urdf\"\nfloating = true\n")).expect("a cart"));
    let scene = system.scene("plane").expect("plane");
    for substeps in [8, 32] {
        let mut batch = Batch::new(&system, &scene, 1);
        let height = 0.1;
        let start = Body::state([0.0, 0.0, height], UPRIGHT, [0.0; 3], [1.0, 0.0, 0.0]);
        batch.reset(0, &[&start[..7], &[0.0; 4], &start[7..], &[1.0 / height; 4]].concat());
        let mut solver = Articulated::new(ArticulatedConfig::implicit(substeps, Friction::Coulomb));
        let mut first = 0.0;
        for frame in 0..360 {
            solver.step(&mut batch, &[0.0; 4]).expect("finite");
            let state = batch.state(0);
            let v = (vector(&state[14..17]) + vector(&state[11..14]).cross(&vector(state))).x;
            // A second to settle on its springs.
            if frame == 59 {
                first = v;
            }
            if frame == 359 {
                let what = format!("{substeps} substeps: {first:.6} m/s after 1 s, {v:.6} m/s after 6 s, aside {:.1e} m", state[1]);
                println!("{what}");
                assert!((v / first - 1.0).abs() < 1e-5 && (first - 1.0).abs() < 1e-3, "{what}");
            }
        }
    }
}

#[test]
fn a_can_stands_lies_and_tips() {
    let (radius, length, k) = (0.03, 0.1, 1e4);
    let system = cylinder(radius, length, [k, 50.0, 1e4, 0.5]);
    let about = |angle: f64| UnitQuaternion::from_axis_angle(&Vector3::y_axis(), angle);
    let leans = |s: &[f64]| (quaternion(&s[3..7]) * Vector3::z()).angle(&Vector3::z());
    // Beyond this it tips.
    let edge = (2.0 * radius / length).atan();
    for (tilt, rests) in [(0.0, 0.0), (0.8 * edge, 0.0), (1.2 * edge, FRAC_PI_2), (FRAC_PI_2, FRAC_PI_2)] {
        let height = 0.5 * length * tilt.cos() + radius * tilt.sin();
        let start = Body::state([0.0, 0.0, height], angles(&about(tilt)), [0.0; 3], [0.0; 3]);
        let states = roll(&system, &start, 300, 8);
        let last = &states[299];
        let (leans, fast) = (leans(last), speed(last).norm());
        let what =
            format!("started at {tilt:.3} rad, tips beyond {edge:.3}: rests at {leans:.4} rad, height {:.4} m, {fast:.1e} m/s", last[2]);
        println!("{what}");
        let low = if rests == 0.0 { 0.5 * length } else { radius };
        assert!((leans - rests).abs() < 0.01 && (last[2] - low).abs() < 1e-3, "{what}");
        assert!(rests > 0.0 || fast < 1e-6, "{what}");
    }
}
