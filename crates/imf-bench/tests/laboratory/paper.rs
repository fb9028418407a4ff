//! The paper's tables at their smallest scale, by the real binary: they hold in direction, and nothing is done twice.

use std::fs;
use std::path::PathBuf;

use serde_json::Value;

use crate::binary::Workdir;

const TINY: &str = "paper --scale tiny --device cpu --out out";

fn table<'a>(report: &'a Value, id: &str) -> &'a Value {
    report["tables"].as_array().unwrap().iter().find(|table| table["id"] == id).unwrap()
}

/// MSE of the row whose labels begin so.
fn mse(report: &Value, id: &str, labels: &[&str]) -> f64 {
    let is_it = |row: &&Value| {
        let found = row["labels"].as_array().unwrap().iter().map(|label| label.as_str().unwrap());
        found.zip(labels).all(|(found, label)| found.starts_with(label))
    };
    let rows = table(report, id)["rows"].as_array().unwrap();
    let row = rows.iter().find(is_it).unwrap_or_else(|| panic!("no row {labels:?} in table {id}"));
    row["values"][0]["ours"].as_f64().unwrap()
}

#[test]
fn the_tiny_tables_hold_in_direction_also_where_they_were_interrupted() {
    let work = Workdir::new();
    // Half of the tables, and their cells, as by another machine at the same time.
    let halves = std::thread::scope(|scope| {
        let there = scope.spawn(|| {
            // That one is interrupted in its first training, and goes on.
            let line = "paper --scale tiny --device cpu --out there --only 3d --json";
            #[cfg(unix)]
            {
                let first = format!("{line} --checkpoint-every 0");
                work.interrupted_once_it_says("training 5×64", &first)
                    .interrupted(&["run the same command again"]);
                assert!(!work.path("there/report.md").exists());
            }
            let done = work.imf(line).done();
            assert!(!cfg!(unix) || done.stderr.contains("going on at epoch"), "{}", done.stderr);
            done.json()
        });
        [work.json(&format!("{TINY} --only 2d,transfer,sparsity,architecture")), there.join().unwrap()]
    });
    for folder in ["cells", "runs"] {
        for entry in work.path("there").join(folder).read_dir().unwrap() {
            let path = entry.unwrap().path();
            fs::rename(&path, work.path("out").join(folder).join(path.file_name().unwrap())).unwrap();
        }
    }
    let report = work.json(TINY);
    // What was kept is what was made.
    for made in halves.iter().flat_map(|half| half["tables"].as_array().unwrap()) {
        assert_eq!(made, table(&report, made["id"].as_str().unwrap()));
    }

    // Seeds are fixed: the margins leave room for another order of f32 sums on another machine.
    let [single, multi] = ["single", "multi"]
        .map(|recipe| [MARK_OUT, "64 random"].map(|asked| mse(&report, "3d", &["teapot", recipe, asked])));
    assert!(multi[0] < 0.75 * single[0], "unseen section: multi {:e}, single {:e}", multi[0], single[0]);
    assert!(multi[1] < 0.75 * single[1], "random sections: multi {:e}, single {:e}", multi[1], single[1]);
    for asked in ["IMF over 225", "64 random"] {
        let [tuned, random] =
            ["fine-tuned", "random weights"].map(|start| mse(&report, "transfer", &[start, asked]));
        assert!(tuned < 0.5 * random, "{asked}: {tuned:e} fine-tuned, {random:e} from random weights");
    }
    // At a rate that follows the width a wider network is better everywhere.
    for asked in ["section (12°, 6°)", "IMF over 225", "64 random"] {
        let [narrow, wide] = ["5×32", "5×128"].map(|network| mse(&report, "architecture", &[network, asked]));
        assert!(wide < 0.85 * narrow, "{asked}: {wide:e} at width 128, {narrow:e} at 32");
    }
    // What any field must beat, and what is exact by its making.
    for part in ["teapot", "bracket", "screw-gear"] {
        let table = |field| if field == "single" { "3d" } else { "3d-others" };
        let random = |field| mse(&report, table(field), &[part, field, "64 random"]);
        assert!(random("single") < random("nearest"), "{part}");
        assert!(random("linear") < random("nearest") && random("harmonic") < random("nearest"), "{part}");
        // It was distilled from the harmonic field.
        assert!(random("factored") < 1.1 * random("harmonic"), "{part}");
        assert_eq!(mse(&report, "3d-others", &[part, "linear", "section (0°, 0°)"]), 0.0);
    }
    let imf = |method| mse(&report, "2d", &[method, "IMF over 145"]);
    assert!(imf("linear") < 1e-3 && imf("cubic spline") < 1e-3 && imf("network") < 1e-3);

    // The paper's value, ours and their ratio.
    let row = &table(&report, "3d")["rows"][0];
    let of_mse = &row["values"][0];
    let [paper, ours, ratio] = ["paper", "ours", "ratio"].map(|key| of_mse[key].as_f64().unwrap());
    assert_eq!((paper, ratio), (7.353e-7, ours / 7.353e-7));
    let text = work.text("out/report.md");
    assert!(text.contains("| teapot | multi |"), "{text}");
    assert!(
        text.contains("| MSE paper | MSE ours | ours / paper |") && text.contains("falls short"),
        "{text}"
    );
    assert!(text.contains("screw-gear (ours)"), "our parts are marked");
    assert!(
        text.contains("| part | field | meets of the paper's single |") && text.contains("this was tried"),
        "{text}"
    );
    let page = work.text("out/report.html");
    assert!(page.matches("src=\"").count() >= 5, "pictures");
    assert_eq!(page.matches("src=\"").count(), page.matches("src=\"data:image/png;base64,").count());

    // The same again trains nothing and finds the same.
    let again = work.imf(&format!("{TINY} --json")).done();
    assert!(
        !again.stderr.contains("training") && again.stderr.contains("single-teapot: kept"),
        "{}",
        again.stderr
    );
    assert_eq!(again.json()["tables"], report["tables"]);

    // Cells and pictures alone, as from another machine, are enough to report; what is missing is said, not made.
    fs::remove_dir_all(work.path("out/runs")).unwrap();
    let cells = work.path("out/cells").read_dir().unwrap().map(|entry| entry.unwrap().path());
    let gone = |path: &PathBuf| path.file_name().unwrap().to_str().unwrap().starts_with("multi-teapot");
    let kept = work.imf(&format!("{TINY} --finished --json")).done();
    assert_eq!(kept.json()["tables"], report["tables"]);
    cells.filter(gone).for_each(|path| fs::remove_file(path).unwrap());
    let less = work.imf(&format!("{TINY} --finished --json")).done();
    assert!(!less.stderr.contains("training"), "{}", less.stderr);
    assert!(table(&less.json(), "3d")["notes"].to_string().contains("teapot, multi: not trained yet"));
    assert_eq!(table(&less.json(), "transfer"), table(&report, "transfer"));
    // A damaged cell is told, and nothing is written where no cell is found.
    let path = work.path("out/cells").read_dir().unwrap().map(|entry| entry.unwrap().path());
    let transfer = path.into_iter().find(|path| path.to_str().unwrap().contains("transfer")).unwrap();
    fs::write(&transfer, "{}").unwrap();
    let damaged = work.imf(&format!("{TINY} --finished")).done();
    assert!(damaged.stderr.contains("is damaged or of another version"), "{}", damaged.stderr);
    assert!(
        damaged.stdout.contains("0 of 4 cells at or below the paper's, 4 without a result"),
        "{}",
        damaged.stdout
    );
    for id in ["2d", "time"] {
        let before = work.path("out/cells").read_dir().unwrap().map(|entry| entry.unwrap().path());
        let name = if id == "2d" { "plane" } else { "single" };
        let own = before.filter(|path| path.file_name().unwrap().to_str().unwrap().starts_with(name));
        own.for_each(|path| fs::remove_file(path).unwrap());
    }
    let left = work.imf(&format!("{TINY} --finished --only 2d,time,transfer,sparsity --json")).done().json();
    for (id, cells) in [("2d", 8), ("time", 12)] {
        let values = table(&left, id)["rows"]
            .as_array()
            .unwrap()
            .iter()
            .flat_map(|row| row["values"].as_array().unwrap());
        assert_eq!(
            values.filter(|value| !value["paper"].is_null()).count(),
            cells,
            "{id}: they count as not met"
        );
    }
    let before = work.text("out/report.md");
    work.imf(&format!("{} --finished", TINY.replace("tiny", "reduced")))
        .refused(&["no cell in out/cells is"]);
    assert_eq!(work.text("out/report.md"), before);
}

/// What tiny asks in place of the paper's (12°, 6°).
const MARK_OUT: &str = "section (22.5°, 11.25°)";
