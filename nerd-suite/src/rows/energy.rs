//! Rows of energy gains: long frames, tosses, fast spins, a chain that hits itself. Rows of friction that sticks: a
//! cube on a slope, at rest and sliding.

use super::*;

/// Frame times (s) of the row `long steps`.
const STEPS: [f64; 5] = [1.0 / 240.0, 1.0 / 60.0, 0.05, 0.1, 0.25];
/// Duration (s) of each fall of the row `long steps`.
const FALL: f64 = 3.0;
/// Robots of the row `long steps`, each with the scene that it falls in.
const ROBOTS: [(&str, &str); 6] = [
    ("cartpole", "free"),
    ("pendulum", "ground1"),
    ("franka", "free"),
    ("cube", "ground"),
    ("ant", "ground"),
    ("anymal", "ground"),
];
/// Inclination of the slope in the row `creep`, divided by the cube's friction angle.
const SHARE: f64 = 0.6;
/// Duration (s) of the row `creep`.
const MINUTE: f64 = 60.0;
/// Inclination of the slope in the row `break-away`, divided by the cube's friction angle.
const STEEP: f64 = 1.3;

pub(super) const ROWS: &[Row] = &[
    row(
        "long steps",
        "largest gain, six robots fall limp, frames of 1/240 to 1/4 s",
        "of the start's energy",
        1e-3,
        "contact, limits and joints are passive",
        "A frame may be as long as a user has it: what it is too long for must be lost, not invented.",
        sweep,
    ),
    row(
        "tosses",
        "largest gain, coin, rod and box tossed at 60 rad/s, 3 s",
        "of the start's energy",
        1e-3,
        "contact is passive",
        "Thin edges meet the ground fast and at a slant: there springs give back more than they took.",
        tosses,
    ),
    row(
        "fast spin",
        "largest change of energy, box at 200 rad/s in free flight, 10 s",
        "of the start's energy",
        1e-4,
        "energy is kept in free flight",
        "A root turns by radians in a frame, and no joint tells.",
        flight,
    ),
    row(
        "clapping chain",
        "largest gain, five rods that meet each other, no gravity, 3 s",
        "of the start's energy",
        1e-3,
        "contact is passive",
        "Links of one robot meet at joint angles that no ground explains.",
        chain,
    ),
    row(
        "creep",
        "way of a cube at 60 % of its friction angle in a minute",
        "m",
        1e-4,
        "Coulomb's law: what is held does not move; 1e-4 m is a hair's width",
        "A foot that stands, or a grasp that holds, must not slip away.",
        creep,
    ),
    row(
        "break-away",
        "way of a cube at 1.3 times its friction angle in 2 s from rest",
        "relative",
        0.02,
        "Coulomb's law, g (sin a - mu cos a) t^2 / 2; 2 % of Newton's tests",
        "Friction that sticks must let go: beyond its cone it is a force alone.",
        slide,
    ),
];

/// Largest gain of energy (springs included), divided by the start's kinetic, spring and fall energy. Returns 1 (a
/// failure) if no coordinate moved by 0.1 rad or m. Gains are measured from the previous minimum of the energy. For
/// rigid contacts they are measured from the start, since rebounds are not gains.
fn gain(trial: &Trial, motion: &Motion, height: f64) -> f64 {
    let moved = |state: &Vec<f64>| motion.states[0].iter().zip(state).any(|(a, b)| (a - b).abs() > 0.1);
    if !motion.states.iter().any(moved) {
        return 1.0;
    }
    let totals = motion.totals();
    let stored = motion.stored();
    let size = totals[0].kinetic + stored[0] + totals[0].mass * GRAVITY * height;
    let energies = motion.energies();
    if trial.method.rigid {
        return most(energies.iter().map(|e| e - energies[0])) / size;
    }
    rise(energies.iter().zip(&stored).map(|(e, s)| e + s)) / size
}

fn sweep(trial: &Trial) -> Result<f64> {
    worst(ROBOTS.into_iter().flat_map(|robot| STEPS.map(|time| (robot, time))), |((name, scene), time)| {
        let mut system = (*trial.robot(name)?).clone();
        system.frame_time = time;
        let system = Arc::new(system);
        worst(0..2, |seed| {
            let mut state = start(&system, Start::Reset, &mut stream(31, seed));
            // Sets joint velocities: a balanced robot, or one without gravity, would otherwise stay in place.
            let rates = state[system.robot.nq() + system.robot.root_dofs()..].iter_mut();
            rates.zip([2.0, -2.0].into_iter().cycle()).for_each(|(rate, to)| *rate = to);
            if system.robot.floating() {
                state[2] += 0.2;
            }
            Ok(gain(trial, &trial.passive(&system, scene, &state, (FALL / time) as usize)?, 0.5))
        })
    })
}

fn tosses(trial: &Trial) -> Result<f64> {
    let shapes = [
        (r#"<cylinder radius="0.05" length="0.01"/>"#, 0.1, [6.3e-5, 6.3e-5, 1.25e-4]),
        (r#"<capsule radius="0.01" length="0.4"/>"#, 0.3, [4e-3, 4e-3, 1.5e-5]),
        (r#"<box size="0.3 0.2 0.05"/>"#, 1.0, [3.5e-3, 7.7e-3, 1.08e-2]),
    ];
    worst(shapes, |(shape, mass, inertia)| {
        let system = Body { shape: shape.into(), mass, inertia, ..Default::default() }.system()?;
        worst(0..8, |seed| {
            let mut random = stream(32, seed);
            let mut drawn =
                |size: f64| (Vector3::from_fn(|_, _| random.random_range(-1.0..1.0f64)).normalize() * size).into();
            let w = drawn(60.0);
            let v = drawn(2.0);
            let turn = UnitQuaternion::from_scaled_axis(Vector3::from(drawn(2.0)));
            let start = Body::state([0.0, 0.0, 1.0], turn.coords.into(), w, v);
            Ok(gain(trial, &trial.passive(&system, "ground", &start, 180)?, 1.0))
        })
    })
}

fn flight(trial: &Trial) -> Result<f64> {
    let body = Body {
        shape: r#"<box size="0.3 0.2 0.05"/>"#.into(),
        inertia: [3.5e-3, 7.7e-3, 1.08e-2],
        gravity: 0.0,
        ..Default::default()
    };
    let axis = Vector3::new(1.0, 3.0, -2.0).normalize() * 200.0;
    let start = Body::state([0.0, 0.0, 100.0], UPRIGHT, axis.into(), [0.0; 3]);
    let motion = trial.passive(&body.system()?, "ground", &start, 600)?;
    let totals = motion.totals();
    let change = most(totals.iter().map(|t| (t.kinetic / totals[0].kinetic - 1.0).abs()));
    Ok(if motion.last()[3..7] == UPRIGHT { 1.0 } else { change })
}

fn chain(trial: &Trial) -> Result<f64> {
    const RODS: usize = 5;
    let rod = |k: usize| {
        format!(
            r#"<link name="l{k}"><inertial><origin xyz="0 0 -0.1"/><mass value="1"/><inertia ixx="3.4e-3" ixy="0" ixz="0" iyy="3.4e-3" iyz="0" izz="2e-4"/></inertial>
            <collision><origin xyz="0 0 -0.1"/><geometry><cylinder radius="0.02" length="0.2"/></geometry></collision></link>"#
        )
    };
    let hinge = |k: usize| {
        format!(
            r#"<joint name="j{k}" type="continuous"><parent link="l{}"/><child link="l{k}"/><origin xyz="0 0 -0.2"/><axis xyz="0 1 0"/></joint>"#,
            k - 1
        )
    };
    let parts: String = (0..RODS).map(rod).chain((1..RODS).map(hinge)).collect();
    let toml = "like = \"urdf\"\nfloating = true\nself_collision = true\ngravity = [0.0, 0.0, 0.0]\n";
    let system = Arc::new(System::from_text("chain", &format!("<robot name=\"chain\">{parts}</robot>"), Some(toml))?);
    let mut state = system.default_state();
    let nq = system.robot.nq();
    state[nq + 6..].copy_from_slice(&[4.0, -3.0, 3.5, -2.0]);
    Ok(gain(trial, &trial.passive(&system, "free", &state, 180)?, 0.0))
}

/// Rolls out a cube on a slope of this angle (rad) for `time` (s), and returns its states. The cube is released just
/// above its resting position.
fn leaning(trial: &Trial, angle: f64, time: f64) -> Result<Vec<Vec<f64>>> {
    let body = Body { slope: angle, ..Default::default() };
    let system = body.system()?;
    let turn = UnitQuaternion::from_axis_angle(&Vector3::y_axis(), angle);
    // Starts 1 mm above the cube's resting position on four corners.
    let deep = body.mass * GRAVITY * angle.cos() / (4.0 * body.material[0]);
    let place = turn * Vector3::z() * (0.101 - deep);
    let start = Body::state(place.into(), turn.coords.into(), [0.0; 3], [0.0; 3]);
    Ok(trial.passive(&system, "ground", &start, (60.0 * time) as usize)?.states)
}

fn creep(trial: &Trial) -> Result<f64> {
    let friction = Body::default().material[3];
    let states = leaning(trial, SHARE * friction.atan(), MINUTE)?;
    let [begun, settled, last] = [0, 60, states.len() - 1].map(|k| vector(&states[k]));
    // Leaves out the first second, in which the cube lands and rocks.
    Ok(if (settled - begun).norm() < 5e-4 { 1.0 } else { (last - settled).norm() })
}

fn slide(trial: &Trial) -> Result<f64> {
    let friction = Body::default().material[3];
    let time = 2.0;
    let angle = STEEP * friction.atan();
    let states = leaning(trial, angle, time)?;
    let way = vector(&states[states.len() - 1]) - vector(&states[0]);
    let way = way.x.hypot(way.z);
    let right = 0.5 * GRAVITY * (angle.sin() - friction * angle.cos()) * time * time;
    Ok((way / right - 1.0).abs())
}
