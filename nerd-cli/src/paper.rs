//! Errors and rewards published in the paper (*Neural Robot Dynamics*, 2025), for comparison.
//!
//! Double pendulum: appendix, Table A.2 (2048 starts, 100 steps, mean joint-angle error in rad). All else is from the
//! main text: Cartpole (1000 steps), Ant (500 steps) and rewards of policies. Errors of Ant are root position (m),
//! orientation (rad) and joints (rad).

/// A robot's name without the suffix `-paper`.
fn plain(robot: &str) -> &str {
    robot.strip_suffix("-paper").unwrap_or(robot)
}

/// Published mean errors of the learned simulator, in the order of [`nerd_train::evaluate::summary`]; `None` if
/// unpublished. The paper measures errors against its reference simulator, so only our errors against the preset
/// `paper` are comparable.
pub fn passive_error(robot: &str, scene: &str) -> Option<Vec<f64>> {
    let pair = match (plain(robot), scene) {
        ("cartpole", "free") => Some([0.033, 0.075]),
        ("pendulum", "free") => Some([0.004, 0.007]),
        ("pendulum", "ground1") => Some([0.012, 0.015]),
        ("pendulum", "ground2") => Some([0.008, 0.011]),
        ("pendulum", "ground3") => Some([0.005, 0.011]),
        ("pendulum", "ground4") => Some([0.011, 0.018]),
        ("pendulum", "ground5") => Some([0.029, 0.056]),
        ("pendulum", "ground6") => Some([0.008, 0.013]),
        ("ant", "ground") => return Some(vec![0.057, 0.095, 0.077]),
        _ => None,
    };
    pair.map(Vec::from)
}

/// Published mean episode rewards `[in the truth, in the learned simulator]`; `None` if unpublished. The policies were
/// trained in the learned simulator with three seeds. Each played 2048 episodes.
pub fn policy_reward(task: &str) -> Option<[f64; 2]> {
    Some(match task {
        "cartpole-swingup" => [1212.5, 1212.6],
        "franka-reach" => [89.3, 91.1],
        "franka-reach-torque" => [94.9, 95.0],
        "ant-run" => [2541.5, 2649.5],
        "ant-spin" => [2624.7, 3076.2],
        "ant-spin-track" => [1630.2, 1670.5],
        "anymal-forward" => [1323.4, 1323.1],
        "anymal-side" => [1360.2, 1359.2],
        _ => return None,
    })
}
