//! Fuzzes energy conservation: no robot may gain more energy than its torques put in. A case drops one random robot on
//! `GROUNDS` random grounds, passive or under random torques. Each rollout is repeated with 1, 4 and 8 substeps a
//! frame.

use nerd_core::dynamics::totals;
use nerd_core::state::wrap;
#[cfg(feature = "cuda")]
use nerd_sim::articulated::device::{CudaArticulated, Real};
use rand::{Rng, RngExt};

use super::text::Dice;
use crate::prelude::*;

/// Largest permitted energy gain, divided by the initial energy plus the absolute work of the torques.
const MOST: f64 = 1e-3;
/// Like `MOST`, for free flight without self-collision.
const MOST_IN_FLIGHT: f64 = 1e-4;
/// Number of grounds of a case.
const GROUNDS: usize = 16;
/// Number of starts on each ground, on the CPU.
const STARTS: usize = 1;
/// Number of starts on each ground, on a GPU. More cost little there: most of a case's time goes into compiling
/// kernels.
const STARTS_ON_CARD: usize = 4;
/// Simulated time of a case (s).
const TIME: f64 = 2.0;
/// Number of frames for which drawn torques are held.
const HOLD: usize = 10;

/// Random starts of a case, stored as `start.toml`: one `Toss` for each ground.
#[derive(Serialize, Deserialize, Clone, Debug)]
struct Start {
    seed: u64,
    toss: Vec<Toss>,
}

#[derive(Serialize, Deserialize, Clone, Debug)]
struct Toss {
    /// Root height (m).
    height: f64,
    /// Root angular speed (rad/s).
    spin: f64,
    /// Root linear speed (m/s).
    speed: f64,
    /// Largest joint velocity (rad/s or m/s).
    rate: f64,
    /// Largest drawn torque, as a fraction of each joint's torque amplitude.
    torque: f64,
}

/// Draws a robot's URDF, its TOML and a start.
pub(super) fn draw(dice: &mut Dice) -> Result<Vec<(String, Vec<u8>)>> {
    let flight = dice.random_bool(0.15);
    let links = dice.random_range(0..6usize).saturating_sub(2);
    let toml = specification(dice, flight);
    let urdf = robot(dice, links + 1);
    let upto = |dice: &mut Dice, most: f64| most * dice.random_range(0.0..1.0f64).powi(2);
    let toss = (0..GROUNDS).map(|_| Toss {
        // Raises the root by the length of the chain below it: penetration at the start would add energy.
        height: 0.8 + 0.3 * links as f64 + upto(dice, 1.2),
        spin: upto(dice, if flight { 200.0 } else { 60.0 }),
        speed: upto(dice, 4.0),
        rate: upto(dice, 20.0),
        torque: if dice.random() { 0.0 } else { dice.random_range(0.0..1.0) },
    });
    let start = Start { toss: toss.collect(), seed: dice.random() };
    let files = [("robot.urdf", urdf), ("robot.toml", toml), ("start.toml", toml::to_string(&start)?)];
    Ok(files.map(|(name, text)| (name.to_string(), text.into_bytes())).into())
}

/// Draws a URDF of `count` links with random shapes: a serial chain, or all other links jointed to the first.
fn robot(dice: &mut Dice, count: usize) -> String {
    let star = dice.random_bool(0.4);
    let mut mass = dice.random_range(0.1..3.0f64);
    let mut text = String::new();
    let lighter = dice.random_range(0.3..1.0);
    for k in 0..count {
        let (shape, [x, y, z]) = shape(dice, mass);
        text += &format!(
            "<link name=\"l{k}\"><inertial><mass value=\"{mass}\"/><inertia ixx=\"{x}\" iyy=\"{y}\" izz=\"{z}\" ixy=\"0\" ixz=\"0\" iyz=\"0\"/>\
             </inertial><collision><geometry>{shape}</geometry></collision></link>"
        );
        if k > 0 {
            let parent = if star { 0 } else { k - 1 };
            let turn = std::f64::consts::TAU * k as f64 / (count - 1) as f64;
            let at = if star { format!("{} {} 0", 0.2 * turn.cos(), 0.2 * turn.sin()) } else { "0 0 -0.25".into() };
            let axis = ["1 0 0", "0 1 0", "0 0 1"][dice.random_range(0..3)];
            let (kind, limit) = match dice.random_range(0..3) {
                0 => ("continuous", "<limit effort=\"5\" velocity=\"50\"/>".to_string()),
                1 => {
                    let end = dice.random_range(0.3..2.0);
                    ("revolute", format!("<limit lower=\"-{end}\" upper=\"{end}\" effort=\"5\" velocity=\"50\"/>"))
                }
                _ => ("prismatic", "<limit lower=\"-0.1\" upper=\"0.1\" effort=\"20\" velocity=\"5\"/>".to_string()),
            };
            let loss = if dice.random() {
                format!("<dynamics damping=\"{0}\" friction=\"{0}\"/>", dice.random_range(0.0..0.2))
            } else {
                String::new()
            };
            text += &format!(
                "<joint name=\"j{k}\" type=\"{kind}\"><parent link=\"l{parent}\"/><child link=\"l{k}\"/><origin xyz=\"{at}\"/>\
                 <axis xyz=\"{axis}\"/>{limit}{loss}</joint>"
            );
            mass *= lighter;
        }
    }
    format!("<robot name=\"drawn\">{text}</robot>")
}

/// Draws a URDF shape, and returns its principal moments of inertia (kg m^2) for `mass` (kg).
fn shape(dice: &mut Dice, mass: f64) -> (String, [f64; 3]) {
    let mut size = |least: f64, most: f64| dice.random_range(least..most);
    let [a, b, c] = [size(0.02, 0.2), size(0.02, 0.2), size(0.02, 0.3)];
    let cylinder = |r: f64, l: f64| {
        let across = mass * (3.0 * r * r + l * l) / 12.0;
        [across, across, 0.5 * mass * r * r]
    };
    match size(0.0, 5.0) as usize {
        0 => (format!("<sphere radius=\"{a}\"/>"), [0.4 * mass * a * a; 3]),
        1 => (
            format!("<box size=\"{a} {b} {c}\"/>"),
            [b * b + c * c, a * a + c * c, a * a + b * b].map(|x| mass * x / 12.0),
        ),
        2 => (format!("<cylinder radius=\"{a}\" length=\"{}\"/>", 0.2 * b), cylinder(a, 0.2 * b)),
        3 => (format!("<cylinder radius=\"{}\" length=\"{c}\"/>", 0.5 * a), cylinder(0.5 * a, c)),
        _ => (format!("<capsule radius=\"{}\" length=\"{c}\"/>", 0.3 * a), cylinder(0.3 * a, c)),
    }
}

/// Draws the TOML of a floating robot: without gravity if `flight`, else with `GROUNDS` random grounds.
fn specification(dice: &mut Dice, flight: bool) -> String {
    let mut text = String::from("like = \"urdf\"\nfloating = true\n");
    if dice.random_bool(0.3) {
        text += "self_collision = true\n";
    }
    if flight {
        return text + "gravity = [0.0, 0.0, 0.0]\n";
    }
    if dice.random_bool(0.7) {
        let mut number = |least: f64, most: f64| 10f64.powf(dice.random_range(least..most));
        let stiffness = number(3.0, 5.0);
        let damping = number(0.0, 3.0);
        let (damping, friction) =
            if dice.random_bool(0.3) { (0.0, 0.0) } else { (damping, dice.random_range(0.0..1.2)) };
        text += &format!(
            "material = {{ stiffness = {stiffness}, damping = {damping}, friction_damping = 1e3, friction = {friction} }}\n"
        );
    }
    for k in 0..GROUNDS {
        text += &ground(dice, k);
    }
    text
}

/// Draws the TOML of the k-th ground: a level or inclined plane, uneven terrain, or a box and a peg.
fn ground(dice: &mut Dice, k: usize) -> String {
    let lean = if dice.random_bool(0.3) { dice.random_range(-0.4..0.4) } else { 0.0 };
    let grounds = [
        "",
        "",
        "terrain = { kind = \"rubble\", height = 0.05, cell = 0.1 }\n",
        "terrain = { kind = \"slopes\", height = 0.2, cell = 0.3 }\n",
        "terrain = { kind = \"steps\", height = 0.1, cell = 0.3 }\n",
        "box = [{ size = [0.4, 0.4, 0.2], position = [0.0, 0.0, 0.1] }]\npeg = [{ radius = 0.05, height = 0.3, position = [0.0, 0.4, 0.15] }]\n",
    ];
    let ground = grounds[dice.random_range(0..grounds.len())];
    let lean = if ground.is_empty() { lean } else { 0.0 };
    format!("[[scene]]\nname = \"ground{k}\"\nplane = {{ height = 0.0, angles = [0.0, {lean}, 0.0] }}\n{ground}")
}

/// Steps a case. Returns `Err` if its files are refused, and a message if the energy gain exceeds its limit.
pub(super) fn judge(files: &[(String, Vec<u8>)], card: bool) -> Result<Option<String>> {
    let text = |name: &str| -> Result<&str> {
        let (_, bytes) = files.iter().find(|(own, _)| own == name).with_context(|| format!("no {name}"))?;
        Ok(std::str::from_utf8(bytes)?)
    };
    let system = Arc::new(System::from_text("robot", text("robot.urdf")?, Some(text("robot.toml")?))?);
    let start: Start = toml::from_str(text("start.toml")?)?;
    let flight = system.gravity().norm() == 0.0;
    if start.toss.is_empty() {
        bail!("start.toml has no [[toss]]");
    }
    let names = (0..start.toss.len()).map(|k| if flight { "free".to_string() } else { format!("ground{k}") });
    let scenes = names.map(|name| system.scene(&name)).collect::<Result<Vec<_>, _>>()?;
    let most = if flight && !system.spec.self_collision { MOST_IN_FLIGHT } else { MOST };
    for substeps in [1, 4, 8] {
        let config = ArticulatedConfig::implicit(substeps, Friction::Coulomb);
        let starts = if card { STARTS_ON_CARD } else { STARTS };
        let Gain { share, ground, frame } = gain(&system, &scenes, &start, starts, &mut *solver(config, card)?)?;
        // Treats a NaN as an energy gain above the limit.
        if share > most || share.is_nan() {
            return Ok(Some(format!(
                "gains {share:.1e} of its energy at x{substeps} on ground {ground}, by frame {frame}"
            )));
        }
    }
    Ok(None)
}

/// Makes the solver: in f32 on a GPU if `card`, else on the CPU.
fn solver(config: ArticulatedConfig, card: bool) -> Result<Box<dyn Solver>> {
    built_for(card)?;
    #[cfg(feature = "cuda")]
    if card {
        return Ok(Box::new(CudaArticulated::new(config, Real::F32)));
    }
    Ok(Box::new(Articulated::new(config)))
}

/// The largest energy gain, with its ground and frame. `share` is the gain divided by the initial energy plus the
/// absolute work.
struct Gain {
    share: f64,
    ground: usize,
    frame: usize,
}

/// Rolls out `starts` environments on each ground, and returns the largest energy gain of all.
fn gain(
    system: &Arc<System>,
    scenes: &[Arc<Scene>],
    start: &Start,
    starts: usize,
    solver: &mut dyn Solver,
) -> Result<Gain> {
    let grounds = scenes.len();
    let envs = grounds * starts;
    let mut batch = Batch::new(system, &scenes[0], envs);
    batch.scenes = (0..envs).map(|env| scenes[env % grounds].clone()).collect();
    let mut data = Data::new(&system.robot);
    let mut dice = stream(start.seed, 0);
    let nq = system.robot.nq();
    let joints = system.robot.joint_count();
    for env in 0..envs {
        toss(&start.toss[env % grounds], batch.state_mut(env).split_at_mut(nq), &mut dice);
    }
    let mut energy = |state: &[f64], env: usize| {
        let own = totals(&system.robot, state, &mut data);
        let gravity = &scenes[env % grounds].gravity;
        let height = start.toss[env % grounds].height;
        (own.energy(gravity), own.kinetic + own.mass * gravity.norm() * height)
    };
    let begun: Vec<(f64, f64)> = (0..envs).map(|env| energy(batch.state(env), env)).collect();
    let largest = system.torque_amplitudes();
    let mut torques = vec![0.0; envs * joints];
    let mut work = vec![(0.0, 0.0); envs];
    let mut worst = Gain { share: 0.0, ground: 0, frame: 0 };
    for frame in 0..(TIME / system.frame_time) as usize {
        if frame % HOLD == 0 {
            let share = |k: usize| start.toss[k / joints % grounds].torque;
            let draw = |k: usize| share(k) * largest[k % joints] * dice.random_range(-1.0..1.0);
            torques = (0..envs * joints).map(draw).collect();
        }
        let before = batch.states.clone();
        solver.step(&mut batch, &torques)?;
        for (env, ((work, effort), (first, size))) in work.iter_mut().zip(&begun).enumerate() {
            let now = batch.state(env);
            let then = &before[env * system.robot.state_dim()..];
            for (way, torque) in ways(system, then, now).zip(&torques[env * joints..]) {
                *work += torque * way;
                *effort += (torque * way).abs();
            }
            let share = (energy(batch.state(env), env).0 - first - *work) / (size + *effort);
            if share > worst.share || share.is_nan() {
                worst = Gain { share, ground: env % grounds, frame };
            }
        }
    }
    Ok(worst)
}

/// Draws a free root's pose and velocities, and joint velocities, in the ranges of `toss`.
fn toss(toss: &Toss, (q, qd): (&mut [f64], &mut [f64]), dice: &mut impl Rng) {
    let mut drawn = |size: f64| Vector3::from_fn(|_, _| dice.random_range(-1.0..1.0f64)).normalize() * size;
    let turn = drawn(3.0);
    let w = drawn(toss.spin);
    let v = drawn(toss.speed);
    let place = Vector3::z() * toss.height;
    q[..3].copy_from_slice(place.as_slice());
    let half = 0.5 * turn.norm();
    q[3..6].copy_from_slice((turn * (half.sin() / turn.norm())).as_slice());
    q[6] = half.cos();
    qd[..3].copy_from_slice(w.as_slice());
    qd[3..6].copy_from_slice((v - w.cross(&place)).as_slice());
    qd[6..].iter_mut().for_each(|x| *x = toss.rate * dice.random_range(-1.0..1.0));
}

/// Turn (rad) or travel (m) of each joint over a frame, from state `then` to state `now`.
fn ways<'a>(system: &'a System, then: &'a [f64], now: &'a [f64]) -> impl Iterator<Item = f64> + 'a {
    let velocity = system.robot.nq() + 6;
    system.robot.joints().enumerate().map(move |(k, joint)| {
        let way = now[7 + k] - then[7 + k];
        if !joint.wraps() {
            return way;
        }
        // Unwraps the angle: beyond half a turn in a frame, the joint velocity gives the number of turns.
        let expected = 0.5 * system.frame_time * (now[velocity + k] + then[velocity + k]);
        expected + wrap(way - expected)
    })
}
