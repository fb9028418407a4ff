//! What a shop asks, by the real binary at a small size: every plan is proven, and less asks for no more set-ups; least stick-outs against
//! exact counts, a crib against its tools one by one, and a machine's poses.

use crate::binary::Workdir;

#[test]
fn the_fewest_set_ups_are_proven_for_reference_parts_and_random_ones() {
    let work = Workdir::new();
    let report =
        work.json("shop --only setups --parts 2 --points 150 --directions 40 --cover 100,90 --out out");
    let rows = report["setups"].as_array().unwrap();
    assert_eq!(rows.len(), 2 * (4 + 2), "{report}");
    for pair in rows.chunks(2) {
        assert_eq!((&pair[0]["part"], &pair[0]["points"]), (&pair[1]["part"], &150.into()));
        let number = |row: usize, name: &str| pair[row][name].as_u64().unwrap();
        for row in [0, 1] {
            assert!(number(row, "setups") >= 1, "{pair:?}");
            assert_eq!(number(row, "setups"), number(row, "at_least"), "{pair:?}");
        }
        assert!(number(1, "setups") <= number(0, "setups"), "{pair:?}");
    }
    // A block with features on several sides.
    assert!(rows[8]["part"] == "prismatic 0" && rows[8]["setups"].as_u64().unwrap() > 1, "{report}");
    assert!(work.text("out/shop.md").contains("| prismatic 1 |"));
}

#[test]
fn answers_are_exact_and_a_crib_is_its_tools() {
    let work = Workdir::new();
    let small = "--surface-points 300 --directions 20 --checks 400 --tools 60 --alone 3 --lines 200";
    let report = work.json(&format!("shop --only stick-out,crib,machine {small} --out out"));
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
