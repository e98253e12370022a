//! Height fields of an MJCF's world: kernels against the solver.

use super::*;

/// Crates that fall onto two bounded height fields (one tilted), over their edges, and on a plane beside them.
fn fallen(others: &str) -> Case {
    let text = format!(
        r#"<mujoco><asset><hfield name="hill" nrow="4" ncol="3" size=".6 .5 .2 .1" elevation="0 1 2 3 1 4 1 5 9 2 6 5"/><hfield name="flat" nrow="2"
        ncol="2" size=".5 .3 .1 .2"/></asset><worldbody><geom type="hfield" hfield="hill" euler="0 0 40"/>{others}<body name="crate" pos="0 0 1"><freejoint/>
        <geom type="box" size=".06 .05 .04" mass="1"/><body pos="0 0 .05"><joint axis="0 1 0" range="-40 40"/><geom type="sphere" size=".03"
        pos=".05 0 .05" mass=".1"/></body></body></worldbody></mujoco>"#
    );
    // Over the hill, its edge, the tilted field, the plane.
    Case::fallen(&text, [[0.0, 0.0, 0.3], [0.45, 0.35, 0.3], [1.5, 0.0, 0.2], [0.2, 0.9, 0.0]], 0.12, 12)
}

#[test]
fn fields_that_end_are_as_the_solver_has_them() {
    let Some(compiler) = Compiler::find() else { return };
    let beside = r#"<geom type="hfield" hfield="flat" pos="1.5 0 .1" euler="5 -10 0"/><geom type="plane" size="5 5 .1" pos="0 0 -.08"/>"#;
    // Alone, the hill's bounding plane is checked first.
    for (others, colliders) in [(beside, 3), ("", 1)] {
        let case = fallen(others);
        case.touches_all(colliders);
        let [double, single] = [Real::F64, Real::F32].map(|real| case.apart(&compiler, real, 3));
        assert!(double.states(0) < 1e-6, "{colliders} colliders: {double:?}");
        // In f32 some crates take the other side of an edge.
        assert!(single.states(4) < 1e-2, "{colliders} colliders, in f32: {single:?}");
    }
}
