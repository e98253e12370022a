//! Reads the rows of a table in SI units, with coordinates in the order of states.

use super::data::{LogError, bad};
use super::spec::{Axes, LogSpec, Published, RootColumns, Units};
use crate::files::renamed::{self, Kind};
use crate::table::{Place, Row, Table, twice};
use crate::{arrays::Arrays, internal::*};

/// Largest magnitude accepted as a measurement, in SI units; times since an epoch (s) are below this bound.
const MAX_MEASUREMENT: f64 = 1e11;

#[derive(Clone, Debug)]
pub(super) struct Moment {
    pub place: Place,
    /// Time (s); NaN without a time column.
    pub time: f64,
    /// Coordinates q in the form of a state.
    pub q: Vec<f64>,
    /// Velocities: for a floating root the angular velocity and the velocity of its origin, in world axes, then joints.
    /// NaN where not measured.
    pub qd: Vec<f64>,
    /// Joint torques (N m or N); NaN where a cell is empty.
    pub torques: Vec<f64>,
}

/// Consecutive rows of a trajectory.
#[derive(Clone, Debug)]
pub(super) struct Raw {
    pub id: u64,
    pub moments: Vec<Moment>,
}

struct Columns<'a> {
    spec: &'a LogSpec,
    trajectory: Option<usize>,
    time: Option<usize>,
    root: Option<Root<'a>>,
    /// For each joint: column indices of position, velocity and torque, and whether the joint is a slide.
    joints: Vec<([Option<usize>; 3], bool)>,
}

struct Root<'a> {
    spec: &'a RootColumns,
    position: Vec<usize>,
    quaternion: Vec<usize>,
    velocity: Option<Vec<usize>>,
    ang_vel: Option<Vec<usize>>,
}

/// Reads a log's TOML, and the robot that it names.
pub fn specified(path: &Path) -> Result<(LogSpec, Arc<System>), LogError> {
    let text = crate::files::read_text(path).map_err(|e| bad(path, e.to_string()))?;
    let (text, old) = renamed::toml(Kind::Log, &text).map_err(|e| bad(path, e))?;
    renamed::note(&path.display().to_string(), old);
    let spec: LogSpec = toml::from_str(&text).map_err(|e| bad(path, e.to_string().trim().replace('\n', " ")))?;
    for Published { method, position, rotation } in &spec.published {
        let within = |key: &str, x: f64| {
            within(format!("[[published]] {method}: {key}"), x, 0.0..=1e9, "").map_err(|e| bad(path, e))
        };
        within("position", *position).and_then(|()| within("rotation", *rotation))?;
    }
    within("cost", spec.cost.unwrap_or(1.0), 1e-6..=1e12, "us").map_err(|e| bad(path, e))?;
    let beside = path.with_file_name(&spec.robot);
    let name = if beside.exists() { beside.display().to_string() } else { spec.robot.clone() };
    let system = System::named(&name)?;
    let named: Vec<&str> = spec.joints.iter().map(|j| j.name.as_str()).collect();
    if let Some(joint) = system.robot.joints().find(|j| !named.contains(&j.name.as_str())) {
        return Err(bad(
            path,
            format!("no [[joint]] has the position of joint `{}` of robot `{}`", joint.name, system.name),
        ));
    }
    if let Some(name) = named.iter().find(|name| system.robot.joints().all(|j| j.name != **name)) {
        return Err(bad(path, format!("[[joint]] `{name}`: robot `{}` has no such joint", system.name)));
    }
    if let Some(twice) = twice(spec.joints.iter().map(|j| &j.name)).or_else(|| twice(columns(&spec))) {
        return Err(bad(path, format!("`{twice}` is used for two things")));
    }
    match (&spec.root, system.robot.floating()) {
        (None, true) => {
            Err(bad(path, format!("robot `{}` has a free base: [root] must have its position", system.name)))
        }
        (Some(_), false) => Err(bad(path, format!("robot `{}` is fixed: [root] means nothing", system.name))),
        _ => Ok((spec, system)),
    }
}

fn columns(spec: &LogSpec) -> Vec<&String> {
    let root = spec.root.iter().flat_map(|r| {
        let rates = r.velocity.iter().chain(&r.ang_vel).flatten();
        r.position.iter().chain(&r.quaternion).chain(rates)
    });
    let joints = spec
        .joints
        .iter()
        .flat_map(|j| [Some(&j.position), j.velocity.as_ref(), j.torque.as_ref()].into_iter().flatten());
    spec.trajectory.iter().chain(&spec.time).chain(root).chain(joints).collect()
}

impl<'a> Columns<'a> {
    fn new(table: &Table, spec: &'a LogSpec, system: &System) -> Result<Self, FileError> {
        let many = |names: &[String]| table.columns(names);
        let one = |name: &String| many(std::slice::from_ref(name)).map(|c| c[0]);
        let some = |names: &Option<[String; 3]>| names.as_ref().map(|n| many(n)).transpose();
        let root = |spec: &'a RootColumns| -> Result<Root<'a>, FileError> {
            let (position, quaternion) = (many(&spec.position)?, many(&spec.quaternion)?);
            Ok(Root { spec, position, quaternion, velocity: some(&spec.velocity)?, ang_vel: some(&spec.ang_vel)? })
        };
        let joints =
            system.robot.joints().filter_map(|joint| Some((joint, spec.joints.iter().find(|j| j.name == joint.name)?)));
        let joints = joints.map(|(joint, j)| {
            let velocity = j.velocity.as_ref().map(one).transpose()?;
            let columns = [Some(one(&j.position)?), velocity, j.torque.as_ref().map(one).transpose()?];
            Ok((columns, joint.kind == JointKind::Prismatic))
        });
        Ok(Self {
            spec,
            trajectory: spec.trajectory.as_ref().map(one).transpose()?,
            time: spec.time.as_ref().map(one).transpose()?,
            root: spec.root.as_ref().map(root).transpose()?,
            joints: joints.collect::<Result<_, FileError>>()?,
        })
    }

    fn moment(&self, row: &Row<'_>) -> Result<Moment, FileError> {
        let Units { length, angle, time } = self.spec.units;
        let (mut q, mut qd, mut torques) = (Vec::new(), Vec::new(), Vec::new());
        if let Some(root) = &self.root {
            let p = row.numbers(&root.position)?;
            let x = row.numbers(&root.quaternion)?;
            row.unit(&root.quaternion, &x)?;
            let turn = root.spec.order.turn([x[0], x[1], x[2], x[3]]);
            q.extend(p.iter().map(|p| p * length));
            q.resize(7, 0.0);
            write_quaternion(&mut q[3..], &turn);
            let three = |columns: &Option<Vec<usize>>, unit: f64| -> Result<Vector3<f64>, FileError> {
                let x = columns.as_ref().map(|c| row.numbers(c)).transpose()?;
                Ok(x.map_or(Vector3::repeat(f64::NAN), |x| Vector3::new(x[0], x[1], x[2]) * unit))
            };
            let ang_vel = three(&root.ang_vel, angle)?;
            let ang_vel = if root.spec.axes == Axes::Body { turn * ang_vel } else { ang_vel };
            qd.extend(ang_vel.iter().chain(three(&root.velocity, length)?.iter()));
        }
        for (joint, slides) in &self.joints {
            let unit = if *slides { length } else { angle };
            let number = |c: Option<usize>, absent: f64| c.map_or(Ok(absent), |c| row.numbers(&[c]).map(|x| x[0]));
            q.push(number(joint[0], 0.0)? * unit);
            qd.push(number(joint[1], f64::NAN)? * unit);
            let known = joint[2].is_none_or(|c| !row.empty(c));
            torques.push(if known { number(joint[2], 0.0)? } else { f64::NAN });
        }
        let at = self.time.map_or(Ok(f64::NAN), |c| row.numbers(&[c]).map(|x| x[0] * time))?;
        Ok(Moment { place: row.place, time: at, q, qd, torques })
    }
}

/// The tables of a log: the file itself, or the tables in a folder, in order of their names.
pub fn tables(csv: &Path) -> Result<Vec<PathBuf>, LogError> {
    if !csv.is_dir() {
        return Ok(vec![csv.into()]);
    }
    let entries = std::fs::read_dir(csv).map_err(|e| bad(csv, e.to_string()))?;
    let table = |p: &PathBuf| p.extension().is_some_and(|e| e == "csv") || Arrays::named(p);
    let mut all: Vec<PathBuf> = entries.flatten().map(|e| e.path()).filter(table).collect();
    all.sort();
    if all.is_empty() { Err(bad(csv, "no .csv, .npz or .safetensors in this folder".into())) } else { Ok(all) }
}

/// All rows by trajectory, in order of the numbers. Without a trajectory column, each table is one trajectory, or as
/// many as its arrays hold.
pub(super) fn rows(csv: &Path, spec: &LogSpec, system: &System) -> Result<Vec<Raw>, LogError> {
    let mut all = BTreeMap::new();
    let mut next = 0;
    for csv in &tables(csv)? {
        let own = of_table(csv, next, spec, system)?;
        if own.is_empty() {
            return Err(bad(csv, "no rows".into()));
        }
        next += own.len().max(1) as u64;
        if let Some(id) = own.keys().find(|id| all.contains_key(*id)) {
            return Err(bad(
                csv,
                format!("trajectory {id} is in another table, too; leave `trajectory` out if each table is one"),
            ));
        }
        all.extend(own);
    }
    if let Some(only) = &spec.only {
        if let Some(id) = only.iter().find(|id| !all.contains_key(*id)) {
            return Err(bad(csv, format!("no trajectory {id}, which `only` names")));
        }
        all.retain(|id, _| only.contains(id));
    }
    Ok(all.into_values().collect())
}

/// Trajectories of a table; without a trajectory column they are numbered from `first`.
fn of_table(csv: &Path, first: u64, spec: &LogSpec, system: &System) -> Result<BTreeMap<u64, Raw>, LogError> {
    let mut table = Table::of(csv, &columns(spec))?;
    let columns = Columns::new(&table, spec, system)?;
    let mut all: BTreeMap<u64, Raw> = BTreeMap::new();
    table.rows(|row| {
        let id = columns.trajectory.map_or(Ok(first + row.trajectory().unwrap_or(0)), |c| row.whole(c, u64::MAX))?;
        let mut moment = columns.moment(row)?;
        // Squares of larger numbers overflow, and no real motion reaches them.
        if let Some(x) = moment
            .q
            .iter()
            .chain(&moment.qd)
            .chain(&moment.torques)
            .chain([&moment.time])
            .find(|x| x.abs() > MAX_MEASUREMENT)
        {
            return Err(row.wrong(&format!(": a value of {x:e} in SI units, at most {MAX_MEASUREMENT:e} can be meant")));
        }
        let raw = all.entry(id).or_insert_with(|| Raw { id, moments: Vec::new() });
        let Some(column) = &spec.time else {
            moment.time = raw.moments.len() as f64 * system.frame_time;
            raw.moments.push(moment);
            return Ok(());
        };
        if let Some(last) = raw.moments.last().filter(|last| moment.time <= last.time) {
            let (now, then, at) = (moment.time, last.time, last.place);
            let text = format!(", column `{column}`: {now} s, but {at} was at {then} s: time must go on");
            return Err(row.wrong(&text));
        }
        raw.moments.push(moment);
        Ok(())
    })?;
    Ok(all)
}
