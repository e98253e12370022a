//! Derives the settings of a robot without TOML from the numbers in its file: free base, materials, starts, drives.
//! `cargo xtask inspect --robot my.urdf` prints these settings as a TOML for the file.

use std::f64::consts::PI;

use super::plain::{between, listed, plain, rounded};
use super::{
    base::settle,
    ground::Ground,
    limbs::Limbs,
    motor::{ROTOR_START_TIME, bare, efforts, rotor, torques},
    spread::enough,
    srdf::{ZERO, pose_of},
    stance::bend,
};
use crate::robots::spec::{ControlSpec, JointSpec, RandomGains, RandomPlane, RootSpec, RootStart, StartSpec};
use crate::{internal::*, robots::mjcf::Description, scene::foot};

/// Penetration of contacts at rest, as a share of the robot's extent. Four contacts carry the weight of a robot with a
/// free base, one contact that of a robot with a fixed base.
const REST_PENETRATION: f64 = 1e-3;
/// Time constant (s) of resolving a penetration, as with MuJoCo's defaults.
const RELEASE_TIME: f64 = 0.04;
/// Least range of position targets (rad), as usual in training legged robots.
const MIN_TARGET_RANGE: f64 = 0.25;
/// Creep velocity (m/s) of a contact under a tangential force of a fifth of the weight.
const CREEP: f64 = 1e-3;
/// Friction coefficient of rubber and metal on floors.
const FRICTION: f64 = 0.7;
/// Inertia felt at a joint counts as zero below this share of the robot's mass times its squared extent (kg m^2).
const MIN_INERTIA_SHARE: f64 = 1e-10;
/// Largest height of evaluation starts above the default pose, as a share of the robot's extent.
const MAX_START_HEIGHT: f64 = 0.06;
/// Largest height of possible ground contacts above the lowest point in the default pose, as a share of the extent.
const MAX_CONTACT_HEIGHT: f64 = 0.1;
/// Ratio of a joint's effort to weight times extent above which the effort is not credible.
const MAX_EFFORT_RATIO: f64 = 20.0;
/// Position error (rad) that gives the motor's full effort under a position law.
const FULL_EFFORT_ERROR: f64 = 1.0;
/// Ratio of damping to stiffness (s) of the position law that [`FULL_EFFORT_ERROR`] defines.
const DAMPING_TIME: f64 = 0.025;
/// Largest number of contact points that are all kept. More points are replaced by a few points with the same support.
const MAX_KEPT_POINTS: usize = 24;
/// Largest joint velocity (rad/s or m/s) at starts, or half the URDF's velocity limit if that is less.
const MAX_START_VELOCITY: f64 = 3.0;

/// Whether a robot walks, rolls or flies and so has a free base. True if it has no joints, or if at zero coordinates
/// two or more limbs reach lower than everything else. Pass `robot` as read with a free base.
pub(crate) fn floats(robot: &Robot) -> bool {
    robot.joint_count() == 0 || Limbs::new(robot, &robot.zero_state(), &Vector3::z()).walks()
}

/// The specification of a robot without TOML, from its `file` at `path` and the ground of its start. `defaults`: joint
/// positions (rad or m) that the files state. `choose`: whether to reduce many contact points to a few.
pub(crate) fn derived(
    read: &mut UrdfRobot,
    path: Option<&Path>,
    file: &Description,
    ground: &Ground,
    defaults: &BTreeMap<String, f64>,
    choose: bool,
) -> Spec {
    let UrdfRobot { robot, notes, base, .. } = read;
    let (mut state, pose) = posed(robot, path, file, ground, defaults);
    let mut data = Data::new(robot);
    kinematics(robot, &state, &mut data);
    let touches = !robot.contact_points.is_empty();
    if touches {
        *base = settle(robot, std::mem::take(base), &state, notes);
        if choose {
            keep(robot, &state, notes);
        }
    } else if robot.floating() {
        notes.push("it has nothing to touch with, and falls for ever; give its links collision shapes, or [[contact]] in a .toml".into());
    }
    let size = Size::new(robot, &data, ground);
    let Size { low, extent, weight, .. } = size;
    let floating = robot.floating();
    notes.push(format!(
        "derived where no .toml says otherwise: pose {pose}, {} base{}; `inspect --robot` shows all of it",
        if floating { "free" } else { "fixed" },
        if file.keys.contains_key("gravity") { "" } else { ", gravity along -z" }
    ));
    let [clearance, mut lift] = clearances(robot, &size);
    let height = ground.height(if low.is_finite() { low } else { 0.0 });
    if floating {
        state[..3].copy_from_slice(&ground.place(height));
        let out = ground.lift(robot, &state, [extent, clearance]);
        if out > lift {
            lift = out;
            notes.push(format!("its pose is inside of what stands in its file: it starts at least {out:.2} m higher"));
        }
    }
    let driven = floating && robot.joint_count() > 0;
    let joints = joint_specs(robot, &state, &data, &size, &ground.up, driven, notes);
    let contacts = listed(robot);
    let mut material =
        if touches { material(weight, extent, if floating { 4.0 } else { 1.0 }) } else { Material::default() };
    material.friction = file.surfaces.usual_friction().unwrap_or(material.friction);
    Spec {
        floating,
        substeps: 8,
        material,
        random_plane: (touches && !floating)
            .then_some(RandomPlane { reach: rounded(extent), clearance: rounded(0.01 * extent) }),
        data_scene: (touches && floating).then(|| "plane".into()),
        control: driven.then(|| control(file, weight, extent)),
        root: floating.then(|| root(ground, height, file.quaternion, [extent, lift], touches.then_some(clearance))),
        joints,
        contacts,
        ..plain(robot)
    }
}

/// State and description of the default pose. Joint positions come from the files, else they are zero, or those of bent
/// legs if some joints cannot be at zero.
fn posed(
    robot: &Robot,
    path: Option<&Path>,
    file: &Description,
    ground: &Ground,
    defaults: &BTreeMap<String, f64>,
) -> (Vec<f64>, String) {
    let (mut state, mut pose) = pose_of(robot, path);
    let coords = robot.root_coords();
    if robot.floating() {
        state[3..7].copy_from_slice(&file.quaternion);
    }
    let zero = state.clone();
    for (q, joint) in state[coords..].iter_mut().zip(robot.joints()) {
        *q = defaults.get(&joint.name).copied().unwrap_or(*q);
    }
    if state[coords..] != zero[coords..] {
        pose = "as its files say".into();
    } else if pose == ZERO && bend(robot, &mut state, &ground.up) {
        pose = "on bent legs, since some joints cannot be at zero".into();
    }
    (state, pose)
}

/// Sizes of a robot in its default pose.
struct Size {
    /// Height (m) of each contact point along the ground's normal; `low`: the least of these heights.
    lows: Vec<f64>,
    low: f64,
    /// Largest extent (m) along a world axis; `weight`: the robot's weight (N).
    extent: f64,
    weight: f64,
}

impl Size {
    fn new(robot: &Robot, data: &Data, ground: &Ground) -> Self {
        let place =
            |p: &ContactPoint| p.places().into_iter().map(|at| point_position(data, p.link, &at)).collect::<Vec<_>>();
        let points: Vec<Vector3<f64>> = robot.contact_points.iter().flat_map(place).collect();
        let lows: Vec<f64> = robot.contact_points.iter().map(|p| foot(p, data, &ground.plane.normal)).collect();
        let low = lows.iter().copied().fold(f64::INFINITY, f64::min);
        let round = robot.contact_points.iter().map(|p| p.radius).fold(0.0, f64::max);
        let origins = (0..robot.links.len()).map(|link| data.origin + data.position[link]);
        let all: Vec<Vector3<f64>> = points.iter().copied().chain(origins).collect();
        let across =
            |k: usize| all.iter().fold([f64::INFINITY, -f64::INFINITY], |[a, b], p| [a.min(p[k]), b.max(p[k])]);
        let extent = (0..3).map(across).map(|[low, high]| high - low + 2.0 * round).fold(0.0, f64::max);
        let extent = if extent > 1e-6 { extent } else { 1.0 };
        Self { lows, low, extent, weight: robot.mass() * GRAVITY }
    }
}

/// Clearance (m) of starts from the ground, and least height (m) of starts above the default pose.
fn clearances(robot: &Robot, Size { lows, low, extent, .. }: &Size) -> [f64; 2] {
    let beneath = robot.contact_points.iter().zip(lows).filter(|(_, at)| **at < low + MAX_CONTACT_HEIGHT * extent);
    let round = beneath.map(|(p, _)| p.radius).fold(0.0, f64::max);
    let clearance = round + rounded(REST_PENETRATION * extent);
    // With spheres of several sizes, the centres of smaller ones are nearer to the ground than `clearance`.
    let middles = robot.contact_points.iter().zip(lows).map(|(p, at)| at - low + p.radius);
    let lift = (clearance - middles.fold(clearance, f64::min)).max(0.0);
    [clearance, lift]
}

/// Position law of a robot that walks or rolls.
fn control(file: &Description, weight: f64, extent: f64) -> ControlSpec {
    let gain = stiffness(weight, extent, false);
    ControlSpec {
        relative: false,
        scale: scale(file),
        clamp: true,
        stable_pd: true,
        servo: true,
        data: Some(RandomGains { kp: between(0.1 * gain, 0.6 * gain), kd: between(0.0, 0.01 * gain) }),
    }
}

/// Specifications of the joints. `driven`: whether joints get the position law and efforts of a robot that walks or
/// rolls.
fn joint_specs(
    robot: &Robot,
    state: &[f64],
    data: &Data,
    Size { lows, low, extent, weight }: &Size,
    up: &Vector3<f64>,
    driven: bool,
    notes: &mut Vec<String>,
) -> Vec<JointSpec> {
    let low = *low;
    let extent = *extent;
    let weight = *weight;
    let absurd = |joint: &&Joint| {
        joint.kind != JointKind::Prismatic
            && joint.effort.is_finite()
            && joint.effort > MAX_EFFORT_RATIO * weight * extent
    };
    if let Some(joint) = robot.joints().filter(|_| driven).find(absurd) {
        notes.push(format!(
            "effort {} N m of `{}` is {:.0} times the robot's weight times its extent: a placeholder? Give its [[joint]] gain, kp and kd in a .toml",
            joint.effort,
            joint.name,
            joint.effort / (weight * extent)
        ));
    }
    let torques = torques(robot, up);
    let efforts = efforts(robot, data, lows, low + MAX_CONTACT_HEIGHT * extent);
    let joints = robot.joints().zip(&torques).zip(&state[robot.root_coords()..]).zip(efforts);
    let joints = joints.map(|(((joint, torque), q), effort)| {
        joint_spec(joint, *torque, *q, [weight, extent], driven.then_some(effort))
    });
    let mut joints: Vec<JointSpec> = joints.collect();
    // A URDF states no rotor inertia, and only a joint without any other inertia needs one.
    for (joint, spec) in bare(robot, MIN_INERTIA_SHARE * robot.mass() * extent * extent)
        .into_iter()
        .zip(&mut joints)
        .filter_map(|(bare, spec)| Some((bare?, spec)))
    {
        spec.armature = rotor(&joint, None);
    }
    let guessed = joints
        .iter()
        .filter(|j| j.armature > 0.0)
        .map(|j| format!("{} {}", j.name, j.armature))
        .collect::<Vec<_>>()
        .join(", ");
    if !guessed.is_empty() {
        notes.push(format!(
            "no link resists a turn of these joints in some pose, so they have a guessed armature, effort x {ROTOR_START_TIME} s / velocity (kg m^2 or kg): \
             {guessed}; give them yours in a .toml, or fit it (`calibrate --parameters armature:JOINT`)"
        ));
    }
    joints
}

/// Stiffness (N m/rad) that carries the weight (N) on a lever of the robot's extent (m) with an error of 1 rad. For a
/// slide, the stiffness (N/m) with an error of a twentieth of the extent.
pub(crate) fn stiffness(weight: f64, extent: f64, slides: bool) -> f64 {
    if slides { 20.0 * weight / extent } else { weight * extent }
}

/// Replaces the robot's contact points by a few, if there are many.
fn keep(robot: &mut Robot, state: &[f64], notes: &mut Vec<String>) {
    if robot.contact_points.len() <= MAX_KEPT_POINTS {
        return;
    }
    let (kept, losses) = enough(robot, state);
    let vertices: usize = kept.iter().filter(|p| matches!(p.locus, Locus::Hull { .. })).map(|p| p.places().len()).sum();
    let deeper = robot.links.iter().zip(losses).filter(|(_, loss)| *loss > 5e-5);
    let deeper = deeper.map(|(link, loss)| format!("{} {:.1}", link.name, 1e3 * loss)).collect::<Vec<_>>().join(", ");
    notes.push(format!(
        "{} contact points, some at the deepest of {vertices} vertices in all; by link, how deep (mm) the ground reaches into its shapes: {}; \
         [[contact]] in a .toml names others",
        kept.len(),
        if deeper.is_empty() { "none" } else { &deeper }
    ));
    robot.contact_points = kept;
}

/// Range (rad) of the position targets of a legged robot for an action of 1. It is the median over joints of torque
/// limit over kp in the file, between [`MIN_TARGET_RANGE`] and 1. It is 1 if the file has no gains.
fn scale(file: &Description) -> f64 {
    let joints = file.keys.get("joint").and_then(toml::Value::as_array).into_iter().flatten();
    let number = |joint: &toml::Value, key: &str| joint.get(key).and_then(toml::Value::as_float).filter(|x| *x > 0.0);
    let mut turns: Vec<f64> = joints.filter_map(|joint| Some(number(joint, "gain")? / number(joint, "kp")?)).collect();
    turns.sort_by(f64::total_cmp);
    turns.get(turns.len() / 2).map_or(1.0, |turn| rounded(turn.clamp(MIN_TARGET_RANGE, 1.0)))
}

/// Contact material with which `points` contact points carry the weight (N) at a penetration of [`REST_PENETRATION`].
/// It is half critically damped and creeps little.
fn material(weight: f64, extent: f64, points: f64) -> Material {
    let stiffness = weight / (points * REST_PENETRATION * extent);
    Material {
        stiffness: rounded(stiffness),
        damping: rounded((stiffness * weight / GRAVITY / points).sqrt()),
        friction_damping: rounded(0.2 * weight / CREEP),
        friction: FRICTION,
        release: RELEASE_TIME,
        ..Material::default()
    }
}

/// Default pose and starts. `clearance` is measured from the centres of spherical contacts, `None` without contact
/// points. Starts clear of the ground are higher than the default pose by at least `lift` (m).
fn root(
    ground: &Ground,
    height: f64,
    quaternion: [f64; 4],
    [extent, lift]: [f64; 2],
    clearance: Option<f64>,
) -> RootSpec {
    let above = |share: f64| ground.places(height, height + (lift + share * extent) / ground.slope());
    RootSpec {
        position: ground.place(height),
        quaternion,
        sample: RootStart {
            position: above(0.5),
            tilt: between(0.0, PI / 6.0),
            ang_vel: [between(-2.0, 2.0); 3],
            velocity: [between(-1.0, 1.0); 3],
            clearance,
        },
        // Evaluation starts high enough for joints slightly off their default positions.
        reset: Some(RootStart { position: above(MAX_START_HEIGHT), clearance, ..RootStart::default() }),
    }
}

/// Specification of one joint. `effort`: torque limit (N m or N) of its motor, for a robot that walks or rolls.
fn joint_spec(
    joint: &Joint,
    torque: f64,
    default_q: f64,
    [weight, extent]: [f64; 2],
    effort: Option<f64>,
) -> JointSpec {
    let slides = joint.kind == JointKind::Prismatic;
    let gain = stiffness(weight, extent, slides);
    let (low, high) = match joint.limit {
        Some(limit) => (limit.lower, limit.upper),
        None if slides => (-extent, extent),
        None => (-PI, PI),
    };
    let fast = MAX_START_VELOCITY.min(0.5 * joint.velocity);
    // A standing robot starts near its default pose; an arm anywhere.
    let wide = if effort.is_some() { 0.3 } else { 2.0 * PI };
    let near = 0.1;
    let reach = |turn: f64| if slides { turn.min(1.0) * extent } else { turn };
    let about = |turn: f64| {
        let Range { low: a, high: b } = between(default_q - reach(turn), default_q + reach(turn));
        Range { low: a.clamp(low, high), high: b.clamp(low, high) }
    };
    let (kp, kd) = match effort {
        // A law too stiff for its motor would switch between the torque limits.
        Some(effort) if !slides => (effort / FULL_EFFORT_ERROR, DAMPING_TIME * effort / FULL_EFFORT_ERROR),
        _ => (0.6 * gain, 0.006 * gain),
    };
    JointSpec {
        name: joint.name.clone(),
        default_q,
        torque,
        gain: Some(effort.unwrap_or(torque)),
        kp: rounded(kp),
        kd: rounded(kd),
        sample: StartSpec { q: about(wide), qd: between(-fast, fast), minus: None },
        reset: StartSpec { q: about(near), ..StartSpec::default() },
        ..JointSpec::default()
    }
}
