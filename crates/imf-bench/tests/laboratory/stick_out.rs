//! Least stick-outs against exact counts, a crib against its tools one by one, and a machine's poses, in small.

use crate::binary::Workdir;

#[test]
fn answers_are_exact_and_a_crib_is_its_tools() {
    let work = Workdir::new();
    let small = "--surface-points 300 --directions 20 --checks 400 --tools 60 --alone 3 --lines 200";
    let report =
        work.imf(&format!("shop --only stick-out,crib,machine {small} --out out --json")).done().json();
    let checks = &report["stick_out"]["checks"];
    assert_eq!(checks["answers"], 400, "{checks}");
    assert!(checks["longer"].as_u64().unwrap() > 50, "{checks}");
    assert_eq!([&checks["optimistic"], &checks["pessimistic"]], [0, 0], "{checks}");
    let crib = &report["crib"];
    assert_eq!([&crib["tools"], &crib["cutters"], &crib["different"]], [60, 60, 0], "{crib}");
    let machine = &report["machine_poses"];
    assert!(machine["poses"].as_u64().unwrap() > 1_000, "{machine}");
    assert_eq!(report.get("setups"), None);
}
