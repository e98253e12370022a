//! Gradients of models and of the articulated solver on the GPU against the CPU.

use crate::with::*;

/// Environments of a model, and of the articulated solver.
const N: usize = 512;
const MANY: usize = 4096;

pub fn gradients(checks: &mut Checks) -> Outcome {
    for (robot, scene) in [("cartpole", "free"), ("franka", "free"), ("ant", "ground"), ("anymal", "ground")] {
        let system = System::named(robot)?;
        let solver = |device: Device| device.neural(&Path::new("models").join(robot), &system, None, N);
        beside(checks, robot, (&system, scene, N), [solver(Device::Cuda)?, solver(Device::Cpu)?], Some(1e-3))?;
    }
    for (robot, real, most) in [
        ("ant", Real::F64, Some(1e-6)),
        ("anymal", Real::F64, Some(1e-6)),
        ("ant", Real::F32, None),
        ("anymal", Real::F32, None),
    ] {
        let system = System::named(robot)?;
        let config = ArticulatedConfig::accurate(&system);
        let both: [Box<dyn Solver>; 2] =
            [Box::new(CudaArticulated::new(config, real)), Box::new(Articulated::new(config))];
        beside(checks, &format!("{robot}, articulated {real:?}"), (&system, "ground", MANY), both, most)?;
    }
    Ok(())
}

/// Compares next states and vector-Jacobian products of one frame. Errors stay below `most`, if given. Without a bound
/// (f32) a contact may exist in f32 and not in f64: then the median environment is within 1e-3.
fn beside(
    checks: &mut Checks,
    name: &str,
    (system, scene, n): (&Arc<System>, &str, usize),
    [mut card, mut cpu]: [Box<dyn Solver>; 2],
    most: Option<f32>,
) -> Outcome {
    let mut batch = Batch::new(system, &system.scene(scene)?, n);
    (0..n).for_each(|env| batch.reset(env, &start(system, Start::Reset, &mut stream(7, env as u64))));
    let (joints, wide) = (system.robot.joint_count(), 2 * system.robot.nv());
    let torques: Vec<f64> = numbers(3, n * joints).into_iter().map(f64::from).collect();
    (0..30).try_for_each(|_| card.step(&mut batch, &torques))?;
    let by: Vec<f64> = numbers(4, n * 2 * wide).into_iter().map(f64::from).collect();
    let [there, here] = [&mut card, &mut cpu].map(|solver| solver.vjp(&batch, &torques, 2, &by));
    let (there, here) = (there?, here?);
    let pairs = [(&there.next, &here.next), (&there.states, &here.states), (&there.torques, &here.torques)];
    let narrow = |x: &[f64]| x.iter().map(|x| *x as f32).collect::<Vec<f32>>();
    let off = pairs.map(|(a, b)| apart(&narrow(a), &narrow(b)));
    let what = format!("{name}: next states, gradients by states and by torques {off:.1?} from the CPU's");
    match most {
        Some(most) => checks.demand(off.iter().all(|off| *off < most), format!("{what}; {off:?}")),
        None => {
            let width = by.len() / n;
            let mut off: Vec<f64> =
                there.states.chunks(width).zip(here.states.chunks(width)).map(|(a, b)| largest(a, b)).collect();
            off.sort_by(f64::total_cmp);
            checks.demand(off[n / 2] < 1e-3, format!("{what}; by states {:.1e} in the median", off[n / 2]));
        }
    }
    Ok(())
}
