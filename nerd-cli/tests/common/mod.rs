//! Small experiments, and their settings by name.

use nerd_cli::experiments::passive::{Case, Protocol};
use nerd_train::settings::Settings;
use nerd_train::spec::SolverSpec;

/// A pendulum with dry friction, which rapier lacks.
pub const DRY: &str = r#"<robot name="dry"><link name="a"/><link name="b"><inertial><origin xyz="0 0 -0.2"/><mass value="1"/><inertia ixx="0.02" iyy="0.02" izz="0.02"
        ixy="0" ixz="0" iyz="0"/></inertial></link><joint name="j" type="continuous"><parent link="a"/><child link="b"/><axis xyz="0 1 0"/><dynamics friction="0.05"/></joint></robot>"#;

/// Settings by `NAME=VALUE`.
pub fn settings<T: Settings>(set: &[&str]) -> anyhow::Result<T> {
    let one = |text: &&str| {
        let (name, value) = text.split_once('=').expect("NAME=VALUE");
        let key = T::keys().into_iter().find(|key| key.name() == name).expect("a setting");
        Ok((name.into(), key.values.parse(value).map_err(anyhow::Error::msg)?))
    };
    T::default().with(&set.iter().map(one).collect::<anyhow::Result<_>>()?).map_err(anyhow::Error::msg)
}

/// The truth compared with itself, over a few frames.
pub fn truth(change: impl Fn(&mut Protocol)) -> Case {
    let solver = SolverSpec::default();
    let mut asked = Protocol::default();
    (asked.scene, asked.trajectories, asked.frames) = (vec!["ground1".into()], 2, Some(4));
    change(&mut asked);
    Case { robot: "pendulum".into(), solver, truth: None, asked }
}
