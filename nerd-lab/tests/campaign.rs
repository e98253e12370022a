//! Hostile input files, tried in this process; the verb `fuzz` does the same, for longer.

use nerd_lab::campaign::{Campaign, Kind};

#[test]
fn changed_files_of_every_kind_are_refused_or_read() {
    let mut campaign = Campaign::default();
    (campaign.cases, campaign.seed) =
        (std::env::var("NERD_CAMPAIGN").ok().and_then(|n| n.parse().ok()).unwrap_or(11_000), 5);
    let found = campaign.run().expect("tried");
    println!("{}", found.table().markdown());
    assert!(found.faults.is_empty(), "{} faults: {}", found.faults.len(), found.lines(campaign.seed).join("\n"));
    for (kind, [refused, accepted, _]) in found.counts {
        let least = (refused + accepted) / 50;
        // Randomly drawn robots of kind `Energy` are valid, so none needs to be refused.
        assert!(
            (refused > 0 || kind == Kind::Energy) && accepted > least,
            "{}: {refused} refused, {accepted} accepted: it tries nothing",
            kind.name()
        );
    }
    // The same seed and case number give the same file, another seed another file.
    let make = |seed| Kind::Mjcf.make(seed, 7).expect("a case");
    assert_eq!(make(1), make(1));
    assert_ne!(make(1), make(2));
}
