//! A cart on four wheels keeps its speed and height. The stability suite covers a single wheel, a coin, a can and a
//! ball.

use nerd_suite::bodies::{Body, UPRIGHT};

use super::common::*;

#[test]
fn a_cart_keeps_its_speed_and_height() {
    let round = changed(
        &collision([0.0; 3], r#"<cylinder radius="0.1" length="0.04"/>"#),
        "<origin",
        r#"<origin rpy="1.5707963267948966 0 0""#,
    );
    let mut parts = vec![link("cart", 10.0, [0.0; 3], [0.2, 0.4, 0.5], "")];
    for (n, [x, y]) in [[0.3, 0.2], [0.3, -0.2], [-0.3, 0.2], [-0.3, -0.2]].into_iter().enumerate() {
        let wheel = format!("wheel{n}");
        parts.push(link(&wheel, 0.5, [0.0; 3], [0.0013, 0.0025, 0.0013], &round));
        let axle = format!(r#"<origin xyz="{x} {y} 0"/><axis xyz="0 1 0"/>"#);
        parts.push(joint(&format!("axle{n}"), "continuous", ["cart", &wheel], &axle));
    }
    let system =
        Arc::new(System::from_text("cart", &urdf(&parts), Some("like = \"urdf\"\nfloating = true\n")).expect("a cart"));
    let height = 0.1;
    let start = Body::state([0.0, 0.0, height], UPRIGHT, [0.0; 3], [1.0, 0.0, 0.0]);
    let start = [&start[..7], &[0.0; 4], &start[7..], &[1.0 / height; 4]].concat();
    for substeps in [8, 32] {
        let states = motion(&mut implicit(substeps), at(&system, "plane", &start), 0.0, 360);
        // The cart settles on its contact springs during the first second.
        let [first, last] = [59, 359]
            .map(|frame: usize| &states[frame])
            .map(|s| (vector(&s[14..]) + vector(&s[11..]).cross(&vector(s))).x);
        let what = format!(
            "{substeps} substeps: {first:.6} m/s after 1 s, {last:.6} m/s after 6 s, aside {:.1e} m",
            states[359][1]
        );
        assert!((last / first - 1.0).abs() < 1e-5 && (first - 1.0).abs() < 1e-3, "{what}");
        // The wheels are round: the height does not depend on how far they have turned.
        assert!(states.iter().all(|s| (s[2] - height).abs() < 0.01), "{substeps} substeps: not at {height} m");
    }
}
