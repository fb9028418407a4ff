//! `imf export`: a field for other programs.

use anyhow::Result;
use imf_fields::onnx::{onnx_bytes, write_onnx};
use serde_json::json;

use crate::arguments::saved::ExportArguments;
use crate::engine::read_field;
use crate::exit::WrongArgument;
use crate::output::{OutputFile, print_json};
use crate::session::{Session, show_bytes};

/// The field, its graph and the graph's bytes are in memory at once.
const COPIES: u64 = 3;

pub(crate) fn run(session: &Session, arguments: &ExportArguments) -> Result<()> {
    let ExportArguments { field, out } = arguments;
    let named = out.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("onnx"));
    if !named {
        let why = "fields are exported as ONNX graphs; name the file so that it ends in .onnx";
        return Err(WrongArgument(format!("{}: {why}", out.display())).into());
    }
    let file = OutputFile::check(out)?;
    let saved = read_field(session, field)?;
    let bytes = onnx_bytes(&saved);
    session.require_memory(COPIES * bytes, || format!("a graph of {}", show_bytes(bytes)))?;
    write_onnx(&saved, file.begin()?)?;
    let written = std::fs::metadata(out)?.len();
    let family = saved.family();
    if session.json {
        return print_json(&json!({ "file": out.display().to_string(), "family": family, "bytes": written }));
    }
    session.note(&format!("wrote {}: a {family} field in {}", out.display(), show_bytes(written)));
    Ok(())
}
