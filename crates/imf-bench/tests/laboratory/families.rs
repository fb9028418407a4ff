//! Every family side by side, by the real binary at a tiny size: what is exact is so, what must be better is.

use serde_json::Value;

use crate::binary::Workdir;

const TINY: &str = "families --part screw-gear --scale 0.14 --angles 8 --random 12 --siren-steps 400 \
                    --factored-steps 400 --device cpu --out out";

#[test]
fn families_are_judged_alike_and_tables_fit_the_memory_that_they_are_given() {
    let work = Workdir::new();
    let report = work.imf(&format!("{TINY} --json")).done().json();
    let comparison = &report["comparisons"][0];
    assert_eq!((&comparison["part"], &comparison["sections"]), (&"screw-gear".into(), &64.into()));
    let row = |name: &str| -> &Value {
        let rows = comparison["rows"].as_array().unwrap();
        rows.iter().find(|row| row["name"] == name).unwrap_or_else(|| panic!("no row {name}"))
    };
    let number = |name: &str, path: &str| row(name).pointer(path).unwrap().as_f64().unwrap();
    for path in
        ["/everywhere/mse", "/everywhere/mpe", "/near/false_colliding", "/colliding_when_safe", "/imf/mpe"]
    {
        assert_eq!(number("exact", path), 0.0, "{path}");
    }
    // At τ above 0 even exact values of shallow contact pass for free.
    assert!(number("exact", "/near/false_free") < number("nearest section", "/near/false_free"));
    let mse = |name| number(name, "/everywhere/mse");
    let variance = number("exact", "/everywhere/variance");
    assert!(mse("harmonic") < mse("nearest section") && mse("linear in angle") < mse("nearest section"));
    assert!(mse("factored") < 0.2 * variance && mse("siren5") < 0.5 * variance, "{report}");
    // Near the boundary is where decisions go wrong: fewer poses, more errors.
    let of = |path: &str| number("harmonic", path);
    assert!(of("/near/count") < 0.6 * of("/everywhere/count") && of("/near/iou") < of("/everywhere/iou"));
    for (table, model) in [("factored", "factored"), ("siren5", "siren5")] {
        let size = number(&format!("coarse table, as large as {table}"), "/bytes");
        let whole = 4.0 * 400.0 * f64::from(14 * 14 * 9);
        let asked = number(model, "/bytes").min(whole);
        assert!((0.5 * asked..1.6 * asked).contains(&size), "{size} bytes for {asked}");
    }
    let text = work.text("out/families.md");
    assert!(text.contains("| siren5 |") && text.contains("(our part)"), "{text}");
    work.picture("out/screw-gear.png");
}
