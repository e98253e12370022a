//! Published figures, for the column beside ours. Source: paper, appendix Table A.2 (double pendulum, 2048 starts, 100
//! steps, mean joint-angle error in rad); Cartpole (1000 steps) and Ant (500 steps: root position in m, orientation in rad,
//! joints in rad) as reported from the main text; rewards of policies likewise.

/// The robot that a robot `NAME-paper` is like.
fn plain(robot: &str) -> &str {
    robot.strip_suffix("-paper").unwrap_or(robot)
}

/// Published mean errors by quantity ([`nerd_train::evaluate::summary`]), or `None` where nothing is published. They are of the
/// reference simulator, so they stand beside errors from preset `paper` alone.
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

/// Published mean reward of a game under policies trained in the learned simulator (three seeds, 2048 games each): in the truth
/// and in the learned simulator.
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

/// Mean reward by iteration while the released policies learned, means over their three seeds, and steps in an iteration; read
/// from the event files that come with the reference's weights.
pub fn released_curve(task: &str) -> (&'static [(u32, f64)], f64) {
    let steps = if task.starts_with("franka") { 131_072.0 } else { 65_536.0 };
    let points: &[(u32, f64)] = match task {
        "cartpole-swingup" => &[
            (1, -73.7),
            (10, -97.2),
            (25, 1080.7),
            (50, 1177.2),
            (100, 1207.1),
            (150, 1222.9),
            (200, 1166.8),
            (300, 1223.5),
            (400, 1198.9),
            (500, 1195.3),
        ],
        "ant-run" => &[
            (1, 26.7),
            (25, 424.3),
            (50, 1172.2),
            (100, 1894.5),
            (150, 2125.7),
            (200, 2250.3),
            (300, 2443.8),
            (400, 2530.8),
            (500, 2577.3),
        ],
        "ant-spin" => {
            &[(1, 28.4), (25, 581.2), (50, 909.0), (100, 1622.7), (150, 1993.2), (200, 2278.5), (300, 2638.4), (400, 2861.0), (500, 2987.6)]
        }
        "ant-spin-track" => {
            &[(1, 5.9), (25, 142.8), (50, 349.2), (100, 855.7), (150, 1191.0), (200, 1350.0), (300, 1477.3), (400, 1545.6), (500, 1599.1)]
        }
        "franka-reach" => &[(1, -60.3), (10, -23.4), (20, 16.4), (40, 64.2), (60, 77.9), (80, 83.9), (100, 86.4), (150, 89.5), (200, 89.5)],
        "franka-reach-torque" => {
            &[(1, -77.4), (10, -57.8), (20, -35.1), (40, 9.6), (60, 50.7), (80, 70.5), (100, 80.5), (150, 89.8), (200, 91.2)]
        }
        "anymal-forward" => {
            &[(2, 28.6), (25, 111.3), (50, 534.2), (100, 994.5), (150, 1208.9), (200, 1239.0), (400, 1269.0), (600, 1284.2), (1000, 1279.1)]
        }
        "anymal-side" => {
            &[(2, 21.4), (25, 97.0), (50, 416.1), (100, 1088.7), (150, 1251.0), (200, 1291.7), (400, 1318.7), (600, 1313.1), (1000, 1314.1)]
        }
        _ => &[],
    };
    (points, steps)
}
