//! The command line of the Python package: its verbs, and those that need a checkout.

use nerd_cli::call::program;
use nerd_cli::commands::{GROUPS, explained};
use nerd_cli::verbs::Package;

#[test]
fn the_package_has_the_verbs_of_users_and_says_of_others_where_they_are() {
    let mut program = program::<Package>();
    let help = program.render_help().to_string();
    let shown = |verb: &str| help.lines().any(|line| line.starts_with(&format!("  {verb} ")));
    let mut own = 0;
    for verb in GROUPS.iter().flat_map(|(_, verbs)| *verbs) {
        let there = program.find_subcommand(verb).is_some();
        assert_eq!(there, shown(verb), "{verb}: {help}");
        own += usize::from(there);
        if !there {
            let error = program.try_get_matches_from_mut(["nerd", *verb]).expect_err("no verb of the package");
            let said = explained(error, &mut program).to_string();
            assert!(said.starts_with(&format!("error: `{verb}` works in a checkout of the project alone")), "{said}");
        }
    }
    assert_eq!(own, 10, "{help}");
    let error = program.try_get_matches_from_mut(["nerd", "charts"]).expect_err("no verb at all");
    assert!(explained(error, &mut program).to_string().contains("unrecognized subcommand 'charts'"));
}
