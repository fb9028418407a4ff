//! `imf export`: graphs for other programs. What they answer is tested beside the writer.

use crate::binary::Workdir;

#[test]
fn a_field_is_written_as_a_graph_and_nothing_else_is() {
    let folder = Workdir::new();
    let fit = "train harmonic teapot --dims 8,10,16 --allow-coarse --degree 3 --no-calibrate";
    folder.imf(&format!("{fit} --out field.safetensors")).done();
    let said = folder.json("export field.safetensors --out field.onnx");
    let bytes = folder.bytes("field.onnx");
    assert_eq!(
        (said["family"].as_str(), said["bytes"].as_u64()),
        (Some("harmonic"), Some(bytes.len() as u64))
    );
    // The inputs are named in the file, and who wrote it.
    for text in ["position", "direction", "overlap", "imf.box_lower"] {
        assert!(bytes.windows(text.len()).any(|window| window == text.as_bytes()), "{text}");
    }
    folder.refuse_input("export field.safetensors --out field.pb", &["field.pb", "end", ".onnx"]);
    folder.refuse("export none.safetensors --out none.onnx", &["none.safetensors"]);
    assert!(!folder.path("none.onnx").exists());
}
