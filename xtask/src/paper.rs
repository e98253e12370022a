//! Published figures, for the column beside ours. Source: paper, appendix Table A.2 (double pendulum, 2048 starts, 100
//! steps, mean joint-angle error in rad); Cartpole (1000 steps) and Ant (500 steps: root position in m, orientation in rad,
//! joints in rad) as reported from the main text.

/// Published mean errors by quantity ([`nerd_train::evaluate::summary`]), or `None` where nothing is published.
pub fn passive_error(robot: &str, scene: &str) -> Option<Vec<f64>> {
    let pair = match (robot, scene) {
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

/// Frames of the paper's passive-motion protocol.
pub fn horizon(robot: &str) -> usize {
    match robot {
        "cartpole" => 1000,
        "ant" | "anymal" | "anymal-paper" => 500,
        _ => 100,
    }
}
