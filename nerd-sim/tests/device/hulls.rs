//! Hulls, balls and capsules of an MJCF's world: kernels against the solver.

use super::*;

/// Crates that fall on a leaning block, a ball and a capsule, some onto edges and corners.
fn fallen() -> Case {
    let corner = |k: usize| {
        format!("{} {} {} ", 0.4 * (k & 1) as f64 - 0.2, 0.2 * (k & 2) as f64 - 0.2, 0.05 * (k & 4) as f64 - 0.1)
    };
    let block: String = (0..8).map(corner).collect();
    let text = format!(
        r#"<mujoco><asset><mesh name="block" vertex="{block} 0 0 .3"/></asset><worldbody><geom type="mesh" mesh="block" pos=".1 0 0" euler="10 20 30"/>
        <geom type="sphere" size=".15" pos="-.3 .1 0"/><geom type="capsule" fromto="-.1 -.4 0 .4 -.3 .1" size=".1"/><geom type="plane" size="5 5 .1"
        pos="0 0 -.3"/><body name="crate" pos="0 0 1"><freejoint/><geom type="box" size=".06 .05 .04" mass="1"/><body pos="0 0 .05"><joint axis="0 1 0"
        range="-40 40"/><geom type="sphere" size=".03" pos=".05 0 .05" mass=".1"/></body></body></worldbody></mujoco>"#
    );
    // Over the block, the ball, the capsule, the plane.
    Case::fallen(&text, [[0.1, 0.0, 0.4], [-0.3, 0.1, 0.27], [0.15, -0.35, 0.3], [0.9, 0.9, -0.15]], 0.08, 10)
}

#[test]
fn hulls_balls_and_capsules_are_as_the_solver_has_them() {
    let Some(compiler) = Compiler::find() else { return };
    let case = fallen();
    case.touches_all(4);
    let [double, single] = [Real::F64, Real::F32].map(|real| case.apart(&compiler, real, 3));
    assert!(double.states(0) < 1e-6, "{double:?}");
    // In f32 some crates take the other side of an edge.
    assert!(single.states(4) < 1e-2, "in f32: {single:?}");
}
