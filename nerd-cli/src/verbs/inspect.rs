//! `cargo xtask inspect --robot FILE`: prints a robot's specification, including derived values.

use nerd_sim::system::Source;

use crate::{prelude::*, survey::verdict};

#[derive(clap::Args)]
pub struct InspectArgs {
    /// Robot: a name from `list robots` (pendulum, ant-paper, ...), or the path of a .urdf, MJCF (.xml) or cable .toml
    #[arg(long)]
    pub robot: String,
}

/// Prints the specification as TOML, with the assumptions made and whether the robot stands.
pub fn run(args: InspectArgs) -> Result<()> {
    let system = System::named(&args.robot)?;
    let links = system.robot.links.len();
    let joints = system.robot.joint_count();
    let points = system.robot.contact_points.len();
    say!("# {}: {links} links, {joints} joints, {points} contact points, {:.3} kg", system.name, system.robot.mass());
    system.notes.iter().for_each(|note| say!("# {note}"));
    // A built-in robot's file exists and is complete; a cable's has the keys besides `[cable]`.
    if System::texts(&system.name).is_none() && system.source != Source::Cable {
        say!("like = \"urdf\"");
    }
    if joints > 0 {
        say!("# [[joint]]: default (limits), gain, kp, kd, armature");
    }
    for (joint, own) in system.robot.joints().zip(system.joint_specs()) {
        let limits =
            joint.limit.map_or("no limits".into(), |limit| format!("{:.3} to {:.3}", limit.lower, limit.upper));
        let gain = own.gain.unwrap_or(own.torque);
        say!("#   {}: {:.3} ({limits}), {gain}, {}, {}, {}", joint.name, own.default_q, own.kp, own.kd, joint.armature);
    }
    let mut shown = (*system).clone();
    let vertices: usize = shown.spec.contacts.iter().map(|contact| contact.vertices.len()).sum();
    if system.source == Source::Derived && vertices > 0 {
        say!("# [[contact]] is left out here: {points} points of {vertices} vertices");
        shown.spec.contacts.clear();
    }
    // Leaves out an empty list of contacts, which would mean that nothing touches.
    say!("{}", shown.spec_text().replace("contact = []\n", ""));
    say!("# {} (drives as stiff as its size asks for, whatever kp and kd are)", verdict(&system, 1.0));
    Ok(())
}
