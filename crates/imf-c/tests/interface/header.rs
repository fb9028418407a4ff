//! `include/imf.h` is what the sources say.

use std::path::Path;

#[test]
fn the_header_is_generated_from_the_sources() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut config = cbindgen::Config::from_file(root.join("cbindgen.toml")).unwrap();
    let version = env!("CARGO_PKG_VERSION");
    let [major, minor, patch] = [0, 1, 2].map(|place| version.split('.').nth(place).unwrap());
    config.after_includes = Some(format!(
        "\n// Of this header; imf_version() is that of the library.\n#define IMF_VERSION \"{version}\"\n#define IMF_VERSION_MAJOR {major}\n#define \
         IMF_VERSION_MINOR {minor}\n#define IMF_VERSION_PATCH {patch}"
    ));
    let package = std::fs::read_to_string(root.join("imf.pc")).unwrap();
    assert!(package.contains(&format!("\nVersion: {version}\n")), "{package}");
    let sources =
        ["boundary", "values", "field", "query", "world"].map(|name| root.join(format!("src/{name}.rs")));
    let builder =
        sources.iter().fold(cbindgen::Builder::new().with_config(config), cbindgen::Builder::with_src);
    let mut generated = Vec::new();
    builder.generate().unwrap().write(&mut generated);
    let generated = String::from_utf8(generated).unwrap();
    let path = root.join("include/imf.h");
    if std::env::var("IMF_WRITE_HEADER").is_ok_and(|value| value == "1") {
        std::fs::write(&path, &generated).unwrap();
    }
    let kept = std::fs::read_to_string(&path).unwrap_or_default();
    assert!(
        kept == generated,
        "{} differs from what the sources say; run IMF_WRITE_HEADER=1 cargo test -p imf-c --test interface header",
        path.display()
    );
    // Every function that Rust exports is in it.
    for path in &sources {
        let text = std::fs::read_to_string(path).unwrap();
        let exported = text.match_indices("#[unsafe(no_mangle)]").count();
        let functions = text.split("extern \"C\" fn ").skip(1).map(|rest| rest.split('(').next().unwrap());
        let named: Vec<&str> = functions.filter(|name| generated.contains(&format!("{name}("))).collect();
        assert_eq!(named.len(), exported, "{}: {named:?}", path.display());
    }
}
