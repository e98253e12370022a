//! Joints, links and frames by name.

use crate::prelude::*;

const MAX_LISTED: usize = 10;

/// A robot has no part with this name.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("robot `{robot}` has no {kind} `{name}`; {hint}")]
pub struct UnknownName {
    robot: String,
    kind: &'static str,
    name: String,
    hint: String,
}

/// Indices of an independent joint among the joints, in `q` and in `qd`, and the index of the link it carries.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct JointIndex {
    /// Index among the independent joints, in the order of torques and drives.
    pub joint: usize,
    /// Index of the joint's coordinate in `q`.
    pub q: usize,
    /// Index of the joint's DoF in `qd` and `tau`.
    pub qd: usize,
    /// Index of the link that the joint carries.
    pub link: usize,
}

impl Robot {
    /// Indices of an independent joint by name: `q[robot.joint("elbow")?.q] = 0.3`.
    ///
    /// # Errors
    /// If no independent joint has this name. The error lists similar names; for a mimic joint it names the leader.
    pub fn joint(&self, name: &str) -> Result<JointIndex, UnknownName> {
        let own = self.links.iter().enumerate().filter_map(|(link, l)| Some((link, l.joint.as_ref()?)));
        let (followers, moving): (Vec<_>, Vec<_>) = own.partition(|(_, joint)| joint.mimic().is_some());
        if let Some(joint) = moving.iter().position(|(_, joint)| joint.name == name) {
            return Ok(JointIndex {
                joint,
                q: self.root_coords() + joint,
                qd: self.root_dofs() + joint,
                link: moving[joint].0,
            });
        }
        let leader = |joint: &Joint| joint.mimic().map(|m| moving[m.coordinate].1.name.as_str());
        Err(match followers.iter().find(|(_, joint)| joint.name == name).and_then(|(_, joint)| leader(joint)) {
            Some(leader) => self.unknown("joint of its own", name, format!("it follows `{leader}`")),
            None => self.unknown("moving joint", name, near(name, moving.iter().map(|(_, joint)| joint.name.as_str()))),
        })
    }

    /// Index of a moving link by name.
    ///
    /// # Errors
    /// If no moving link has this name. The error names the link on which a body of this name is fixed, or lists
    /// similar names.
    pub fn link(&self, name: &str) -> Result<usize, UnknownName> {
        self.links.iter().position(|l| l.name == name).ok_or_else(|| {
            let hint = match self.frames.iter().find(|f| f.name == name).map(|f| f.link) {
                Some(Some(link)) => format!("it is fixed on `{}` and a frame of it", self.links[link].name),
                Some(None) => "it is fixed on the base".into(),
                None => near(name, self.links.iter().map(|l| l.name.as_str())),
            };
            self.unknown("moving link", name, hint)
        })
    }

    /// A frame by name: that of a moving link ([`Link::frame`]), or one fixed on a link (sole, IMU, tool) or on the
    /// base.
    ///
    /// # Errors
    /// If neither a link nor a frame has this name; the error lists similar names.
    pub fn frame(&self, name: &str) -> Result<FixedFrame, UnknownName> {
        if let Some(link) = self.links.iter().position(|l| l.name == name) {
            return Ok(FixedFrame { name: name.into(), link: Some(link), pose: self.links[link].frame });
        }
        let names = self.links.iter().map(|l| l.name.as_str()).chain(self.frames.iter().map(|f| f.name.as_str()));
        self.frames
            .iter()
            .find(|f| f.name == name)
            .cloned()
            .ok_or_else(|| self.unknown("link or frame", name, near(name, names)))
    }

    fn unknown(&self, kind: &'static str, name: &str, hint: String) -> UnknownName {
        UnknownName { robot: self.name.clone(), kind, name: name.escape_debug().to_string(), hint }
    }
}

/// Text that lists the known names similar to `name`, or if there are none, the first few known names.
fn near<'a>(name: &str, known: impl Iterator<Item = &'a str>) -> String {
    let known: Vec<&str> = known.collect();
    let alike =
        |k: &&&str| strsim::osa_distance(k, name) <= 2 || !name.is_empty() && (k.contains(name) || name.contains(**k));
    let close: Vec<&str> = known.iter().filter(alike).copied().collect();
    let (word, names) = if close.is_empty() { ("it has", known) } else { ("near are", close) };
    let quoted: Vec<String> = names.iter().take(MAX_LISTED).map(|n| format!("`{n}`")).collect();
    let more = names.len().saturating_sub(MAX_LISTED);
    match quoted.len() {
        0 => "it has none".into(),
        _ if more > 0 => format!("{word} {} and {more} more", quoted.join(", ")),
        _ => format!("{word} {}", quoted.join(", ")),
    }
}
