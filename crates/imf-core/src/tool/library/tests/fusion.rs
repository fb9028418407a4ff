//! Fusion's libraries.

use std::io::Write as _;

use super::*;

/// As Fusion exports an end mill in a holder.
fn fusion(kind: &str, name: &str, number: u32, geometry: Value) -> Value {
    let mut all = json!({
        "CSP": false, "HAND": true, "DC": 6.0, "LB": 30.0, "LCF": 18.0, "NOF": 3, "OAL": 57.0, "SFDM": 8.0,
        "shoulder-length": 20.0, "shoulder-diameter": 5.8
    });
    let Value::Object(geometry) = geometry else { panic!("{geometry} is not an object") };
    for (key, value) in geometry {
        all[key] = value;
    }
    json!({
        "BMC": "carbide", "description": name, "geometry": all, "guid": "0", "product-id": format!("P-{number}"),
        "type": kind, "unit": "millimeters", "vendor": "",
        "holder": {
            "description": "ER20", "type": "holder", "unit": "inches",
            "segments": [
                {"height": 1.0, "lower-diameter": 1.0, "upper-diameter": 1.5},
                {"height": 0.0, "lower-diameter": 1.5, "upper-diameter": 1.75},
                {"height": 0.5, "lower-diameter": 1.75, "upper-diameter": 1.75}
            ]
        },
        "post-process": {"number": number, "comment": ""}, "start-values": {"presets": []}
    })
}

/// The tool of a library that holds one entry.
fn read_entry(entry: &Value) -> Result<Tool, String> {
    read("t.json", &json!({"data": [entry]}))
}

#[test]
fn a_shoulder_without_a_diameter_is_as_wide_as_the_cutters_end() {
    let entry = fusion("tapered mill", "taper", 1, json!({"DC": 1.0, "TA": 5.0, "shoulder-diameter": null}));
    let tool = read_entry(&entry).unwrap();
    // 18 mm of edges at 5°, and 2 mm of shoulder.
    let end = 0.5 + 18.0 * 5f64.to_radians().tan();
    close(radius(&tool, 19.0), end);
}

#[test]
fn fusions_tools_become_cutter_shoulder_shaft_and_holder() {
    let library =
        json!({"data": [fusion("bull nose end mill", "6 mm bull", 3, json!({"RE": 1.0}))], "version": 1});
    let tool = read("tools.json", &library).unwrap();
    assert_eq!((tool.name.as_str(), tool.unit), ("6 mm bull", LengthUnit::Mm));
    close(tool.length(), 30.0 + 1.5 * 25.4);
    let kinds: Vec<_> = elements(&tool).iter().map(|e| e.kind).collect();
    let holder = ElementKind::Holder;
    assert_eq!(kinds, [ElementKind::Cutter, ElementKind::Shank, holder(0), holder(1)]);
    for (height, expected) in [
        (0.0, 2.0),
        (1.0, 3.0),
        (19.0, 2.9),
        (25.0, 4.0),
        (30.0, 12.7),
        (30.0 + 12.7, 12.7 * 1.25),
        (30.0 + 25.4, 0.875 * 25.4),
    ] {
        close(radius(&tool, height), expected);
    }

    // A shaft of its own, and a length of the edges that reaches into the holder.
    let mut entry = fusion("flat end mill", "flat", 1, json!({}));
    entry["shaft"] =
        json!({"type": "shaft", "segments": [{"height": 4.0, "lower-diameter": 5.8, "upper-diameter": 8.0}]});
    let tool = read_entry(&entry).unwrap();
    close(radius(&tool, 22.0), 0.25 * (5.8 + 8.0));
    close(radius(&tool, 24.0), 4.0);
    let entry = fusion("ball end mill", "ball", 1, json!({"LCF": 40.0, "shoulder-length": 40.0}));
    let tool = read_entry(&entry).unwrap();
    assert_eq!(elements(&tool).len(), 3);
    close(radius(&tool, 29.0), 3.0);
    // Its radius in fewer digits.
    assert!(read_entry(&fusion("ball end mill", "ball", 1, json!({"DC": 3.175, "RE": 1.588}))).is_ok());
    close(radius(&tool, 31.0), 12.7 + 6.35 / 25.4);

    let shapes = [
        ("drill", json!({"SIG": 90.0}), 1.0, 1.0),
        ("chamfer mill", json!({"TA": 45.0, "tip-diameter": 1.0}), 1.0, 1.5),
        ("tapered mill", json!({"TA": 45.0, "RE": 0.0, "SFDM": 60.0}), 2.0, 5.0),
        ("counter sink", json!({"SIG": 90.0}), 0.5, 0.5),
        ("face mill", json!({"RE": 0.0, "DCX": 6.0}), 1.0, 3.0),
    ];
    for (kind, geometry, height, expected) in shapes {
        let entry = fusion(kind, kind, 1, geometry);
        let tool = read_entry(&entry).unwrap();
        close(radius(&tool, height), expected);
    }
}

#[test]
fn the_flank_of_a_tapered_mill_meets_its_diameter_at_the_tips_height() {
    // Fusion's sample: its shoulder of 20.46 mm follows from diameter, edges and taper.
    let geometry = json!({"DC": 12.0, "LCF": 24.0, "TA": 10.0, "RE": 2.5, "SFDM": 20.46, "LB": 40.0, "shoulder-length": 24.0});
    let tool = read_entry(&fusion("tapered mill", "sample", 1, geometry)).unwrap();
    let slope = 10_f64.to_radians().tan();
    for height in [3.0, 10.0, 23.9] {
        close(radius(&tool, height), 6.0 + height * slope);
    }
    assert!((2.0 * radius(&tool, 24.0 - 1e-9) - 20.46).abs() < 5e-3);
    // Makers' tapered balls, inches: the ball touches the cone, whose diameter at the tip is smaller than the ball's.
    for (diameter, corner, taper) in [(0.0568, 0.03125_f64, 5.5), (0.1176, 0.0625, 3.5), (1.872, 1.0, 3.8)] {
        let geometry = json!({"DC": diameter, "RE": corner, "TA": taper});
        let tool = read_entry(&fusion("tapered mill", "ball", 1, geometry)).unwrap();
        let taper: f64 = f64::to_radians(taper);
        let height = 0.1 * corner;
        let ball = (corner * corner - (corner - height).powi(2)).sqrt();
        assert!((radius(&tool, height) - ball).abs() < 1e-3 * corner);
        assert!((radius(&tool, 10.0) - (0.5 * diameter + 10.0 * taper.tan())).abs() < 1e-3 * corner);
    }
}

#[test]
fn what_widens_a_cutter_is_read_or_refused() {
    let of = |kind: &str, geometry: Value| read_entry(&fusion(kind, kind, 1, geometry));
    for kind in ["flat end mill", "ball end mill", "bull nose end mill", "reamer"] {
        let error = of(kind, json!({"TA": 10.0, "RE": 1.0})).unwrap_err();
        assert!(error.contains("TA 10") && error.contains(kind), "{error}");
    }
    close(radius(&of("face mill", json!({"TA": 45.0, "LCF": 4.0})).unwrap(), 3.0), 6.0);
    close(radius(&of("spot drill", json!({"SIG": 90.0, "tip-diameter": 1.0})).unwrap(), 1.0), 1.5);
    // A flat drill, and a ball whose edges end at its equator.
    close(radius(&of("drill", json!({"SIG": 180.0})).unwrap(), 0.0), 3.0);
    close(
        radius(&of("ball end mill", json!({"LCF": 3.0, "shoulder-length": 3.0})).unwrap(), 2.0),
        8f64.sqrt(),
    );
}

#[test]
fn one_entry_that_is_not_understood_spoils_no_other() {
    let folder = tempdir().unwrap();
    let good = fusion("reamer", "good", 1, json!({}));
    let broken = |key: &str, value: Value| {
        let mut entry = fusion("reamer", "odd", 2, json!({}));
        entry[key] = value;
        entry
    };
    let read = |entry: Value| {
        let path = write(&folder, "tools.json", &json!({"data": [good.clone(), entry]}));
        let mut tools = Tool::read_all(&path).unwrap();
        assert!(tools[0].is_ok());
        assert!(Tool::find(&format!("{}#good", path.display())).is_ok());
        tools.remove(1).map_err(|error| error.to_string())
    };
    for (key, value, said) in [
        ("geometry", Value::Null, "no DC"),
        ("type", Value::Null, "no type"),
        ("type", json!("turning general"), "'turning general'"),
        (
            "holder",
            json!({"segments": [{"height": 1.0, "lower-diameter": 1.0}]}),
            "its holder is not understood",
        ),
    ] {
        let error = read(broken(key, value)).unwrap_err();
        assert!(error.contains("'odd'") && error.contains(said), "{error}");
    }
    assert_eq!(read(broken("description", Value::Null)).unwrap().name, "2");
    assert!(read(broken("product-id", json!(5))).is_ok());
    assert_eq!(elements(&read(broken("holder", json!({"segments": null}))).unwrap()).len(), 2);
    // Rows of zeros, as Fusion writes them.
    let zeros = json!({"segments": [{"height": 0.0, "lower-diameter": 0.0, "upper-diameter": 0.0}]});
    assert_eq!(elements(&read(broken("holder", zeros)).unwrap()).len(), 2);
}

#[test]
fn a_tool_of_several_is_named_and_archives_are_unpacked() {
    let folder = tempdir().unwrap();
    let mut inch = fusion("flat end mill", "1/4 in flat", 5, json!({"DC": 0.25, "LB": 1.0, "LCF": 0.75}));
    inch["unit"] = json!("inches");
    inch["geometry"]["shoulder-length"] = json!(0.8);
    let data = json!([
        fusion("flat end mill", "flat", 1, json!({})),
        inch,
        fusion("ball end mill", "same", 2, json!({})),
        fusion("ball end mill", "Same", 4, json!({})),
        {"type": "holder", "description": "ER20", "segments": [], "unit": "inches"}
    ]);
    let library = json!({"data": data, "version": 1});
    let plain = write(&folder, "shop.json", &library);
    let archive = folder.path().join("shop.tools");
    let mut writer = zip::ZipWriter::new(std::fs::File::create(&archive).unwrap());
    let options = zip::write::SimpleFileOptions::default();
    writer.start_file("tools.json", options).unwrap();
    writer.write_all(library.to_string().as_bytes()).unwrap();
    writer.finish().unwrap();
    for path in [&plain, &archive] {
        let find = |tool: &str| Tool::find(&format!("{}#{tool}", path.display()));
        for name in ["1/4 IN flat", "P-5", "5"] {
            let tool = find(name).unwrap();
            assert_eq!((tool.name.as_str(), tool.unit), ("1/4 in flat", LengthUnit::Inch));
            // The holder is in inches as well here.
            close(tool.length(), 2.5);
        }
        for (name, expected) in [
            ("6", "called '6'"),
            ("same", "2 tools of it are called 'same': name one by its number"),
            ("ER20", "'ER20'"),
        ] {
            let error = find(name).unwrap_err().to_string();
            assert!(error.contains(expected) && error.contains("'1/4 in flat'"), "{error}");
        }
        let error = Tool::read(path).unwrap_err().to_string();
        assert!(error.contains("4 tools; name one"), "{error}");
    }
    // An empty name is nobody's, not that of the one tool that has no description.
    let unnamed = [fusion("reamer", "", 1, json!({})), fusion("reamer", "named", 2, json!({}))];
    let several = write(&folder, "few.json", &json!({"data": unnamed}));
    let single = write(
        &folder,
        "one.fctb",
        &bit("endmill", json!({"Diameter": 6, "Length": 30, "CuttingEdgeHeight": 9})),
    );
    for (path, listed) in [(&several, "'1', 'named'"), (&single, "'a bit'")] {
        for nothing in ["#", "# "] {
            let error = Tool::find(&format!("{}{nothing}", path.display())).unwrap_err().to_string();
            assert!(error.contains("no tool is named behind the #") && error.contains(listed), "{error}");
        }
    }
    // A file of that very name comes first.
    let odd = write(&folder, "odd#5.json", &json!({"data": [fusion("reamer", "odd", 1, json!({}))]}));
    assert_eq!(Tool::find(odd.to_str().unwrap()).unwrap().name, "odd");
}

#[test]
fn what_fusion_has_and_we_do_not_is_refused_by_name() {
    let folder = tempdir().unwrap();
    let mut without_unit = fusion("drill", "d", 1, json!({"SIG": 118.0}));
    without_unit["unit"] = Value::Null;
    let mut unknown_unit = without_unit.clone();
    unknown_unit["unit"] = json!("furlongs");
    let mut broken_holder = fusion("reamer", "d", 1, json!({}));
    broken_holder["holder"]["segments"][0]["height"] = json!(-1.0);
    for (entry, expected) in [
        (fusion("lollipop mill", "l", 1, json!({})), "'lollipop mill'"),
        (fusion("face mill", "f", 1, json!({"DCX": 9.0})), "DCX 9"),
        (fusion("drill", "d", 1, json!({})), "no SIG"),
        (fusion("flat end mill", "f", 1, json!({"DC": 0.0})), "DC is 0"),
        (fusion("flat end mill", "f", 1, json!({"LB": "long"})), "LB is"),
        (fusion("bull nose end mill", "b", 1, json!({"RE": 4.0})), "corner radius 4"),
        (fusion("flat end mill", "f", 1, json!({"RE": 0.5})), "RE 0.5"),
        (fusion("bull nose end mill", "b", 1, json!({})), "no RE"),
        (fusion("flat end mill", "f", 1, json!({"LB": 60.0})), "LB 60"),
        (fusion("ball end mill", "b", 1, json!({"RE": 1.0})), "RE 1)"),
        (without_unit, "no unit"),
        (unknown_unit, "'furlongs'"),
        (broken_holder, "holder"),
    ] {
        let error = read_entry(&entry).unwrap_err();
        assert!(error.contains("t.json") && error.contains(expected), "{error}");
        assert!(error.contains("TOML"), "{error}");
    }
    let path = write(&folder, "t.json", &json!({"tools": []}));
    assert!(Tool::read(&path).unwrap_err().to_string().contains("not an intact tool library"));
    std::fs::write(&path, b"PK\x03\x04 cut short").unwrap();
    assert!(Tool::read(&path).unwrap_err().to_string().contains("not an intact tool library"));
    let missing = folder.path().join("none.tools");
    assert!(Tool::read(&missing).unwrap_err().to_string().contains("there is no tool file"));
}

#[test]
fn all_tools_of_a_library_come_in_order_and_each_error_stays_its_own() {
    let folder = tempdir().unwrap();
    let entries = [
        fusion("flat end mill", "first", 1, json!({"OAL": 70.0})),
        fusion("lollipop mill", "odd", 2, json!({})),
        json!({"type": "holder", "description": "a holder alone"}),
        fusion("reamer", "last", 3, json!({})),
    ];
    let path = write(&folder, "tools.json", &json!({ "data": entries }));
    let tools = Tool::read_all(&path).unwrap();
    let [first, odd, last] = &tools[..] else { panic!("{tools:?}") };
    let first = first.as_ref().unwrap();
    assert_eq!((first.name.as_str(), first.overall_length), ("first", Some(70.0)));
    assert!(odd.as_ref().unwrap_err().to_string().contains("'odd'"));
    assert_eq!(*last.as_ref().unwrap(), Tool::find(&format!("{}#last", path.display())).unwrap());
    let bit = write(&folder, "bit.fctb", &bit("Thread-Mill", json!({"Diameter": "6 mm", "Length": "50 mm"})));
    assert!(Tool::read_all(&bit).unwrap()[0].is_err());
    let broken = folder.path().join("broken.json");
    std::fs::write(&broken, "{").unwrap();
    assert!(Tool::read_all(&broken).is_err());
}
