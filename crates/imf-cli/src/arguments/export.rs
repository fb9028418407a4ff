//! What `imf export` is asked.

use std::path::PathBuf;

use clap::Args;

/// Write a field for other programs: as an ONNX graph, its inputs in the scene's units
#[derive(Args)]
#[command(
    after_help = "Example:\n  imf export model/field.safetensors --out model.onnx\n\nInputs: position [poses, 3] in the \
                  scene's unit, and direction [poses, 3] of the tool's axis from tip to holder; the paper's network takes \
                  angles [poses, 2] instead, (theta, phi) in degrees. Output: overlap [poses], or depth [poses] of a field of depth, in the scene's unit. What the field is of stands in \
                  the graph's metadata. A harmonic field of a tool without symmetry has no such form."
)]
pub(crate) struct ExportArguments {
    /// Field: a model, a harmonic or a factored field
    pub(crate) field: PathBuf,
    /// File to write, ending in .onnx
    #[arg(long, value_name = "FILE")]
    pub(crate) out: PathBuf,
}
