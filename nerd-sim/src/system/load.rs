//! Systems from names, files and texts.

use toml::Table;

use super::built_in::{BUILT_IN, CABLES, FAMILIES, FOREIGN};
use super::start::{MAX_DRAWS, overlaps};
use super::{build::name_columns, model::Source, validate::check};
use crate::files::{
    read_text,
    renamed::{self, Kind},
};
use crate::robots::derive::{Ground, derived, floats, plain, touch};
use crate::robots::{cable::CableSpec, spec::mesh_points, world::World};
use crate::{internal::*, robots::mjcf::Description};

impl System {
    /// A built-in robot or cable by name; by path, the robot of a URDF or MJCF file, or the cable of a TOML
    /// ([`crate::cable`]).
    pub fn named(name: &str) -> Result<Arc<Self>, SystemError> {
        if let Some((_, spec, urdf)) = BUILT_IN.iter().chain(&FAMILIES).find(|b| b.0 == name) {
            return Self::from_text(name, urdf, Some(spec)).map(Arc::new);
        }
        if let Some((_, text)) = CABLES.iter().find(|c| c.0 == name) {
            return Self::from_toml(name, text).map(Arc::new);
        }
        let path = Path::new(name);
        let stem = path.file_stem().map_or_else(|| name.into(), |s| s.to_string_lossy());
        let read = |path: &Path| read_text(path).map_err(|e| FileError::new(path, e));
        match path.extension().and_then(|ending| ending.to_str()) {
            Some("toml") => return Self::from_toml(&stem, &read(path)?).map(Arc::new),
            Some("urdf" | "xml") => {}
            _ => return Err(SystemError::Unknown(name.into())),
        }
        let beside = path.with_extension("toml");
        let spec = beside.exists().then(|| read(&beside)).transpose()?;
        // In the error, the path replaces the file's stem.
        let system = Self::read(&stem, &read(path)?, spec.as_deref(), Some(path)).map_err(|e| match e {
            SystemError::Urdf(_, reason) => SystemError::Urdf(name.into(), reason),
            other => other,
        })?;
        // A specification that names another robot's file must not be applied to this robot.
        match &system.spec.urdf {
            Some(urdf) if path.file_name().is_none_or(|file| file != urdf.as_str()) => {
                let text =
                    format!("urdf = {urdf:?}, but {name} is what is read; write its name, or leave the line out");
                Err(SystemError::Spec(stem.into(), text))
            }
            _ => Ok(Arc::new(system)),
        }
    }

    /// Builds a system from the text of a URDF or MJCF and the text of a specification (TOML). Without a specification,
    /// the result is that of [`System::bare`], with the base that the robot's text states, else a fixed base. The key
    /// `urdf` of the specification has no effect, since no file is read.
    pub fn from_text(name: &str, urdf: &str, spec: Option<&str>) -> Result<Self, SystemError> {
        Self::read(name, urdf, spec, None)
    }

    /// `path` is the robot's file; meshes are found relative to it.
    fn read(name: &str, text: &str, spec: Option<&str>, path: Option<&Path>) -> Result<Self, SystemError> {
        let spec = spec.map(|spec| renewed(name, spec)).transpose()?;
        let spec = spec.as_deref();
        let file = Description::of(text, path).map_err(|e| SystemError::Urdf(name.into(), e))?;
        let own = (file.bodies.clone().into(), path.map(Path::to_path_buf));
        Ok(Self { file: own, ..Self::of(name, file, spec, path)? })
    }

    fn of(name: &str, file: Description, spec: Option<&str>, path: Option<&Path>) -> Result<Self, SystemError> {
        let wrong = |e: String| SystemError::spec(name, e);
        let refused = |e| SystemError::Urdf(name.into(), e);
        let text = match (spec, path) {
            (Some(text), _) => text,
            (None, Some(_)) => return Self::derived(name, file, path, Table::new()),
            (None, None) => return Self::moving(name, &file, file.floating().unwrap_or(false), path),
        };
        if let Some(own) = Spec::like_urdf(text).map_err(wrong)? {
            return Self::derived(name, file, path, own);
        }
        let whole = |e: String| {
            if e.contains("missing field") {
                format!("{e}; write `like = \"urdf\"` first, and what is left out comes from the robot's file")
            } else {
                e
            }
        };
        let spec = Spec::read(text).map_err(|e| wrong(whole(e)))?;
        file.stands(spec.floating).map_err(refused)?;
        let mut read = UrdfRobot::of(&file.bodies, base(spec.floating)).map_err(refused)?;
        read.notes.extend(file.notes.iter().cloned());
        touch(&mut read, path, spec.mesh_points);
        let world = World::of(&file, path, &mut read.notes);
        Self::new(name, read, world, spec, Source::Specified)
    }

    /// Derives a specification from a robot's file, for all keys missing in the partial specification `own`
    /// (`derive.rs`).
    fn derived(name: &str, file: Description, path: Option<&Path>, own: Table) -> Result<Self, SystemError> {
        let points =
            own.get("mesh_points").and_then(toml::Value::as_integer).map_or(mesh_points(), |n| n.max(0) as usize);
        let read = based(&file, path, points, own.get("floating").and_then(toml::Value::as_bool).or(file.floating()));
        let mut read = read.map_err(|e| SystemError::Urdf(name.into(), e))?;
        read.notes.extend(file.notes.iter().cloned());
        if untouched(&own) {
            read.robot.contact_points.clear();
        }
        let defaults =
            [&file.keys, &own].into_iter().flat_map(|keys| keys.get("joint").and_then(toml::Value::as_array)).flatten();
        let default = |joint: &toml::Value| {
            Some((joint.get("name")?.as_str()?.to_string(), joint.get("default_q")?.clone().try_into::<f64>().ok()?))
        };
        let defaults = defaults.filter_map(default).collect();
        let mut keys = file.keys_of(&read.robot);
        // `defaults` already holds the default pose.
        for joint in keys
            .get_mut("joint")
            .and_then(toml::Value::as_array_mut)
            .into_iter()
            .flatten()
            .filter_map(toml::Value::as_table_mut)
        {
            joint.remove("default_q");
        }
        let world = World::of(&file, path, &mut read.notes);
        let ground = Ground::of(&own, &file, (&world.colliders, &world.surfaces));
        let spec = derived(&mut read, path, &file, &ground, &defaults, !own.contains_key("contact")).over(keys);
        let [silent, its_own, rooted] = [own.is_empty(), own.contains_key("data_scene"), own.contains_key("root")];
        let mut spec = spec.and_then(|spec| spec.over(own)).map_err(|e| SystemError::spec(name, e))?;
        let made = match Self::new(name, read.clone(), world.clone(), spec.clone(), Source::Derived) {
            // A robot that slides on the ground of its file is never clear of the ground.
            Err(SystemError::Blocked(..)) if !its_own && file.floating() == Some(false) => {
                read.notes.push("the ground of its file is no scene of its data, since no start is clear of it".into());
                spec.data_scene = None;
                Self::new(name, read, world, spec, Source::Derived)
            }
            made => made,
        };
        let made = made.map(|mut system| {
            system.notes.extend(overlaps(&system));
            system
        });
        made.map_err(|error| reported(error, silent, rooted))
    }

    /// Builds a system from the text of a URDF or MJCF alone. Frames take 1/60 s, torques are zero, and gravity points
    /// along -z unless the text sets it.
    pub fn bare(name: &str, text: &str, floating: bool) -> Result<Self, SystemError> {
        Self::bare_at(name, text, floating, None)
    }

    /// Builds the system of [`System::bare`]; meshes are found relative to the file at `path`.
    pub fn bare_at(name: &str, text: &str, floating: bool, path: Option<&Path>) -> Result<Self, SystemError> {
        let file = Description::of(text, path).map_err(|e| SystemError::Urdf(name.into(), e))?;
        Self::moving(name, &file, floating, path)
    }

    fn moving(name: &str, file: &Description, floating: bool, path: Option<&Path>) -> Result<Self, SystemError> {
        let read = file.stands(floating).and_then(|()| UrdfRobot::of_alone(&file.bodies, base(floating)));
        let mut read = read.map_err(|e| SystemError::Urdf(name.into(), e))?;
        let mut keys = file.keys_of(&read.robot);
        keys.remove("data_scene");
        let spec = plain(&read.robot).over(keys).map_err(|e| SystemError::spec(name, e))?;
        read.notes.extend(file.notes.iter().cloned());
        read.base.clear();
        touch(&mut read, path, spec.mesh_points);
        let world = World::of(file, path, &mut read.notes);
        Self::new(name, read, world, spec, Source::Derived)
    }

    /// Builds a cable from the text of its specification: `[cable]` and other keys.
    pub fn from_toml(name: &str, text: &str) -> Result<Self, SystemError> {
        let wrong = |e: String| SystemError::spec(name, e);
        let mut own: Table = toml::from_str(&renewed(name, text)?).map_err(|e| wrong(e.to_string()))?;
        let Some(cable) = own.remove("cable") else {
            return Err(wrong(
                "there is no [cable] in it, and of other robots the .urdf is named, not the .toml beside it".into(),
            ));
        };
        let cable: CableSpec = cable.try_into().map_err(|e| wrong(format!("[cable]: {e}")))?;
        cable.check().map_err(wrong)?;
        if let Some((key, why)) = FOREIGN.into_iter().find(|(key, _)| own.contains_key(*key)) {
            return Err(wrong(format!("{key}: {why}; leave the line out")));
        }
        let mut robot = cable.robot(name);
        if untouched(&own) {
            robot.contact_points.clear();
        }
        let spec = cable.spec(&robot);
        bounded(&robot, &spec).map_err(wrong)?;
        let spec = spec.over(own).map_err(wrong)?;
        Self::new(name, robot, World::default(), spec, Source::Cable)
    }
}

/// The text of a specification with new names for old keys.
fn renewed(name: &str, text: &str) -> Result<String, SystemError> {
    let (text, old) = renamed::toml(Kind::Robot, text).map_err(|e| SystemError::spec(name, e))?;
    renamed::note(&format!("robot {name}"), old);
    Ok(text)
}

/// Rewords an error in a derived specification in terms of the robot's file.
fn spoken(text: &str) -> String {
    let joint = text.strip_prefix("[[joint]] name = \"").and_then(|rest| rest.split_once("\": "));
    let what = joint.map_or_else(|| text.into(), |(name, what)| format!("joint `{name}`: {what}"));
    format!("what its file makes of it cannot be simulated: {what}")
}

/// Whether a specification has an empty list of contact points.
fn untouched(own: &Table) -> bool {
    own.get("contact").and_then(toml::Value::as_array).is_some_and(Vec::is_empty)
}

fn base(floating: bool) -> Base {
    if floating { Base::Floating } else { Base::fixed() }
}

/// Refuses a cable with derived parameters out of range, even where each of its numbers is within range.
fn bounded(robot: &Robot, spec: &Spec) -> Result<(), String> {
    let mut spec = spec.clone();
    name_columns(robot, &mut spec);
    let together = "[cable] length, diameter, mass, bending, twisting and links make together what is beyond any cable";
    check(&spec, robot).map_err(|e| format!("{together}: {e}"))
}

/// Reads the robot of a file with the base that `floating` asks for; with `None`, with the likelier base.
fn based(
    file: &Description,
    path: Option<&Path>,
    points: usize,
    floating: Option<bool>,
) -> Result<UrdfRobot, UrdfError> {
    let read = |floating| -> Result<UrdfRobot, UrdfError> {
        file.stands(floating)?;
        let mut read = UrdfRobot::of_alone(&file.bodies, base(floating))?;
        touch(&mut read, path, points);
        Ok(read)
    };
    match floating {
        Some(floating) => read(floating),
        // If one kind of base is impossible, the file requires the other.
        None => match read(true) {
            Ok(free) if floats(&free.robot) => Ok(free),
            Ok(free) => Ok(read(false).unwrap_or(free)),
            Err(cause) => match read(false) {
                Ok(mut fixed) => {
                    fixed.notes.push(format!("its base is taken as fixed, since a free one cannot be: {cause}"));
                    Ok(fixed)
                }
                Err(UrdfError::Still) => Err(cause),
                Err(error) => Err(error),
            },
        },
    }
}

/// Reports errors in derived keys as errors of the robot's file, since no user wrote these keys. `silent`: the user
/// wrote no keys; `rooted`: the user wrote `[root]`.
fn reported(error: SystemError, silent: bool, rooted: bool) -> SystemError {
    match error {
        SystemError::Blocked(robot, _, scene, _) if !rooted => SystemError::Blocked(
            robot,
            format!("{MAX_DRAWS} starts above the ground"),
            scene,
            "say where it starts by `position`, `sample` and `reset` of [root] in a .toml beside it, under `like = \"urdf\"`".into(),
        ),
        SystemError::Spec(robot, text) if silent => SystemError::Urdf(robot, UrdfError::Refused(spoken(&text))),
        other => other,
    }
}
