//! Sampling ranges as text: accepted ranges are finite and draw within their bounds, others are refused in one line.

use nerd_sim::range::Range;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

fn range(text: &str) -> Result<Range, String> {
    Range::try_from(text.to_string())
}

#[test]
fn numbers_multiples_of_pi_and_fractions() {
    let pi = std::f64::consts::PI;
    for (text, low, high) in [
        ("U(-pi, pi)", -pi, pi),
        (" U( -2pi ,5pi/9 ) ", -2.0 * pi, 5.0 * pi / 9.0),
        ("U(1/4, 1e3)", 0.25, 1e3),
        ("U(0, 0)", 0.0, 0.0),
    ] {
        assert_eq!(range(text), Ok(Range { low, high }), "{text}");
    }
    for text in [
        "",
        "U",
        "U(",
        "U()",
        "U(1)",
        "U(2, 1)",
        "U(nan, 1)",
        "U(0, inf)",
        "U(0, 1/0)",
        "U(0, 1/1/1)",
        "U(-1e308, 1e308)",
        "N(0, 1)",
    ] {
        assert!(range(text).is_err(), "{text} is read as {:?}", range(text));
    }
    // As long as a file can be: no recursion.
    assert!(range(&format!("U(0, {}1)", "1/".repeat(1_000_000))).is_err());
}

#[test]
fn what_is_written_is_read_again() {
    let mut rng = ChaCha8Rng::seed_from_u64(0);
    for _ in 0..256 {
        let [a, b] = [(); 2].map(|()| 1e9 * (2.0 * rng.random::<f64>() - 1.0));
        let ours = Range { low: a.min(b), high: a.max(b) };
        assert_eq!(range(&ours.to_string()), Ok(ours));
        let x = ours.draw(&mut rng);
        assert!(ours.low <= x && x <= ours.high, "{x} from {ours}");
    }
}
