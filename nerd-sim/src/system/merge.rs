//! Merges the keys of one TOML over the keys of another, so that a specification needs only the keys that differ.
//!
//! `like = "ant"` takes missing keys from the file of the built-in robot `ant`. The file of `ant-paper`, the Ant of the
//! reference simulator, thus has only a few lines. `like = "urdf"` derives missing keys from the URDF (`derive.rs`). A
//! cable's missing keys come from its data sheet.

use toml::Table;

use crate::internal::*;

impl Spec {
    /// Parses the text of a file, with `like` resolved.
    pub fn read(text: &str) -> Result<Self, String> {
        let Some(table) = merged(text)? else { return toml::from_str(text).map_err(|e| e.to_string()) };
        Self::deserialize(table).map_err(|e| e.to_string())
    }

    /// The keys of a file with `like = "urdf"` or `"mjcf"`; `None` for other files.
    pub(crate) fn like_urdf(text: &str) -> Result<Option<Table>, String> {
        let mut own: Table = toml::from_str(text).map_err(|e| e.to_string())?;
        let like = matches!(own.get("like").and_then(toml::Value::as_str), Some("urdf" | "mjcf"));
        own.remove("like");
        Ok(like.then_some(own))
    }

    /// This specification, with its keys replaced by those of `own`. Material and joints (found by name) are replaced
    /// key by key, scenes by name, all other keys as a whole.
    pub(crate) fn over(self, mut own: Table) -> Result<Self, String> {
        if own.is_empty() {
            return Ok(self);
        }
        let mut all = Table::try_from(&self).map_err(|e| e.to_string())?;
        displace(&mut all, &own)?;
        let name = |entry: &toml::Value| entry.get("name").and_then(toml::Value::as_str).map(str::to_string);
        if own.get("joint").is_some_and(|joints| !joints.is_array()) {
            return Err("joint: a list is needed, write [[joint]] before each".into());
        }
        if let (Some(joints), Some(toml::Value::Array(given))) =
            (all.get_mut("joint").and_then(toml::Value::as_array_mut), own.remove("joint"))
        {
            let names: Vec<_> = given.iter().map(name).collect();
            if let Some((_, twice)) = names.iter().enumerate().find(|(k, n)| names[..*k].contains(n)) {
                return Err(format!("[[joint]] name = {:?} appears twice", twice.clone().unwrap_or_default()));
            }
            for joint in given {
                match (joints.iter_mut().find(|known| name(known) == name(&joint)), joint) {
                    (Some(toml::Value::Table(known)), toml::Value::Table(given)) => {
                        // A gain that equals the old torque is a default, which the new torque replaces.
                        if given.contains_key("torque") && known.get("gain") == known.get("torque") {
                            known.remove("gain");
                        }
                        known.extend(given);
                        let wrong = |e| format!("[[joint]] name = {}: {e}", known["name"]);
                        crate::robots::spec::JointSpec::deserialize(known.clone()).map_err(wrong)?;
                    }
                    (_, joint) => {
                        let known: Vec<String> = joints.iter().filter_map(name).collect();
                        return Err(no_joint(&name(&joint).unwrap_or_default(), &known));
                    }
                }
            }
        }
        if let (Some(toml::Value::Table(known)), Some(toml::Value::Table(given))) =
            (all.get_mut("material"), own.get_mut("material"))
        {
            known.iter().for_each(|(key, value)| _ = given.entry(key).or_insert(value.clone()));
        }
        if let (Some(toml::Value::Array(known)), Some(toml::Value::Array(given))) =
            (all.get("scene"), own.get_mut("scene"))
        {
            let others = known.iter().filter(|scene| given.iter().all(|own| name(own) != name(scene))).cloned();
            let others: Vec<_> = others.collect();
            given.splice(..0, others);
        }
        all.extend(own);
        Self::deserialize(all).map_err(|e| e.to_string())
    }
}

/// The keys of a file with `like = NAME`, filled up from that built-in robot; `None` without `like`.
fn merged(text: &str) -> Result<Option<Table>, String> {
    let mut own: Table = toml::from_str(text).map_err(|e| e.to_string())?;
    let Some(like) = own.remove("like") else { return Ok(None) };
    let known = like.as_str().and_then(System::texts);
    let Some((other, _)) = known else {
        return Err(format!(
            "like = {like}: choose from {}, or \"urdf\" for what the URDF suggests",
            System::built_in().join(", ")
        ));
    };
    let mut all = match merged(other)? {
        Some(all) => all,
        None => toml::from_str(other).map_err(|e| e.to_string())?,
    };
    // The `urdf` key of the other robot is not inherited.
    all.remove("urdf");
    displace(&mut all, &own)?;
    all.extend(own);
    Ok(Some(all))
}

/// The training data has one scene: `data_scene` removes an inherited random plane, and vice versa. Removing the scene
/// also removes the clearance of starts.
fn displace(all: &mut Table, own: &Table) -> Result<(), String> {
    match [own.contains_key("data_scene"), own.contains_key("random_plane")] {
        [true, true] => {
            return Err(
                "random_plane and data_scene are two grounds for the training data; leave one of the two out".into()
            );
        }
        [true, false] => _ = all.remove("random_plane"),
        [false, true] if all.remove("data_scene").is_some() => {
            let starts = all.get_mut("root").and_then(toml::Value::as_table_mut);
            let starts =
                starts.into_iter().flat_map(|root| root.iter_mut()).filter_map(|(_, start)| start.as_table_mut());
            starts.for_each(|start| _ = start.remove("clearance"));
        }
        _ => {}
    }
    Ok(())
}

/// The error for an unknown joint name. For a robot with many joints, only the first names and the last are listed.
fn no_joint(name: &str, known: &[String]) -> String {
    let known = match known {
        [first @ .., last] if first.len() > 20 => format!("{}, .., {last}", first[..10].join(", ")),
        all => all.join(", "),
    };
    format!("[[joint]] name = {name:?}: the robot has no such moving joint; it has {known}")
}
