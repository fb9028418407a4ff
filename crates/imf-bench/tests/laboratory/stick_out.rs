//! Least stick-outs against exact counts, and a crib against its tools one by one, in small.

use crate::binary::Workdir;

#[test]
fn answers_are_exact_and_a_crib_is_its_tools() {
    let work = Workdir::new();
    let small = "--points 300 --directions 20 --checks 400 --tools 60 --alone 3";
    let report = work.imf(&format!("stick-out {small} --out out --json")).done().json();
    let checks = &report["checks"];
    assert_eq!(checks["answers"], 400, "{checks}");
    assert!(checks["longer"].as_u64().unwrap() > 50, "{checks}");
    assert_eq!([&checks["optimistic"], &checks["pessimistic"]], [0, 0], "{checks}");
    let crib = &report["crib"];
    assert_eq!([&crib["tools"], &crib["cutters"], &crib["different"]], [60, 60, 0], "{crib}");
}
