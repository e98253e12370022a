//! `cargo xtask rollout --robot pendulum --scene ground3 --preset converged --states FILE.csv --frames 100 --out OUT.csv`. [`TABLES`] describes
//! the files.

use nerd_sim::{
    files::replaceable,
    rollout::{States, written},
};
use nerd_train::bounds::{memory, time};
use nerd_train::progress::bar;

use crate::solvers::{SolverArgs, SolverName};
use crate::{options::FRAMES, prelude::*};

/// What `--help` says of the files.
const TABLES: &str = "\
FILE of --states has a header and one row for each trajectory and step:
  traj, step    whole numbers; the row of step 0 is the trajectory's start
  the state     the robot's coordinates, then its velocities (rad, m, rad/s, m/s), read at step 0 only: a floating root's
                px py pz qx qy qz qw (unit quaternion), the joints by name, the root's twist wx wy wz vx_s vy_s vz_s about the
                world's origin, the joints' rates d_JOINT; of cartpole x theta xdot thetadot, of pendulum q1 q2 qd1 qd2
  torques       all of tau_JOINT (N m or N) or none, held from their row's step to the next; of cartpole tau_cart tau_pole, of
                pendulum tau1 tau2; without them no torque acts
Columns go by these names (a TOML may give others; JOINT is q_NAME where a joint's name is taken, as `step` or `tau1` is), in
any order; other columns are ignored.
OUT has traj, step and the state, with all digits of an f64.";

#[derive(clap::Args, Clone, Debug)]
#[command(after_help = TABLES)]
pub struct RolloutArgs {
    /// Robot: cartpole, pendulum, cube, franka, ant, anymal, each as NAME-paper too, or the path of a .urdf or MJCF (.xml)
    #[arg(long)]
    pub robot: String,
    /// Scene: free, a scene of the robot (ground, or ground1 .. ground6 for the pendulum), plane, slope, box, steps, hills
    #[arg(long, default_value = "free")]
    pub scene: String,
    #[command(flatten)]
    pub solver: SolverArgs,
    /// CSV with starts and torques, see below
    #[arg(long, value_name = "FILE")]
    pub states: PathBuf,
    /// Frames to roll out [default: as many as the file has]
    #[arg(long, value_parser = value::<usize>(Whole(FRAMES)))]
    pub frames: Option<usize>,
    /// CSV to write
    #[arg(long, value_name = "FILE")]
    pub out: PathBuf,
}

pub fn run(args: RolloutArgs) -> Result<()> {
    let system = System::named(&args.robot)?;
    let scene = system.scene(&args.scene)?;
    let choice = args.solver.choose(&system)?;
    replaceable(&args.out, |table| written(table, &system)).map_err(|e| anyhow::anyhow!("--out: {e}"))?;
    if args.solver.solver != Some(SolverName::Neural) {
        unused(&[("--truth", args.solver.truth.is_some())], "without --solver neural, whose model learned it")?;
    }
    let bytes = choice.bytes()?.saturating_add(1024 * system.robot.state_dim());
    let file = States::read(&args.states, &system)?;
    let steps = steps(&args, &file)?;
    let n = file.trajectories.len();
    // The table is written whole, so it is kept until then: some 20 characters a number.
    memory(&[("trajectories", n), ("--frames", steps)], 24 * (system.robot.state_dim() + 2))?;
    memory(&[("trajectories", n)], bytes)?;
    time(&[("trajectories", n), ("--frames", steps), ("substeps", choice.substeps())])?;
    let mut solver = choice.build(&system, n)?;
    let bar = bar("frames", steps as u64);
    let table = file.roll(&system, &scene, &mut *solver, steps, &mut |done| bar.set(done as u64))?;
    bar.finish();
    nerd_lab::report::write(&args.out, &table)
}

/// Frames over all trajectories that a file may ask for by the number of its last step alone: it may be a slip.
const ASKED: usize = 100_000;

/// Frames to roll out, for all of which the file has torques if it has any.
fn steps(args: &RolloutArgs, file: &States) -> Result<usize> {
    let name = args.states.display();
    let (steps, n) = (args.frames.unwrap_or_else(|| file.frames()), file.trajectories.len());
    if args.frames.is_none() && n.saturating_mul(steps) > ASKED.max(file.rows()) {
        bail!("{name}: {n} trajectories to step {steps}, but only {} rows; say with --frames if so many frames are wanted", file.rows());
    }
    if steps == 0 {
        bail!("{name}: there are starts alone, no row after step 0; say with --frames how many frames are wanted");
    }
    file.check(steps)?;
    Ok(steps)
}
