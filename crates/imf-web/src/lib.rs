//! The exact engine in a browser, compiled to WebAssembly: what a tool reaches of a part's surface, whether it collides at a pose,
//! sections, and fields from files beside them.
//!
//! Nothing is computed here that `imf-core` and `imf-fields` do not compute; this crate reads bytes instead of files,
//! and hands out arrays that JavaScript reads. There is one thread and no network. Long work is cut into pieces, so
//! that the caller can show progress between them and stop. `cargo xtask web` builds the module, its TypeScript
//! types, and the page in `page/`.
//!
//! Lengths are in the part's unit, angles in degrees, vectors and points three numbers each, side by side. Directions point from the
//! tool's tip to its holder. Errors are thrown as JavaScript's `Error`, with the text of the library's error.

mod access;
mod field;
mod network;
mod part;
mod scene;

pub use access::SurfaceAccess;
pub use field::{Comparison, Directions, FieldFile};
pub use network::FieldNetwork;
pub use part::Part;
pub use scene::{Contact, PartScene};

use wasm_bindgen::prelude::wasm_bindgen;

#[cfg(target_arch = "wasm32")]
mod console {
    use wasm_bindgen::prelude::wasm_bindgen;

    #[wasm_bindgen]
    extern "C" {
        #[wasm_bindgen(js_namespace = console)]
        fn error(text: &str);
    }

    /// What a panic says, which the browser would report as "unreachable".
    #[wasm_bindgen(start)]
    fn start() {
        std::panic::set_hook(Box::new(|panic| error(&panic.to_string())));
    }
}

/// Colours of a scale from its lowest to its highest value: red, green and blue of each, side by side.
#[wasm_bindgen]
#[must_use]
pub fn ramp(steps: u16) -> Vec<u8> {
    let steps = usize::from(steps);
    let colour = |step: usize| colorous::VIRIDIS.eval_rational(step, steps.max(2));
    (0..steps).map(colour).flat_map(|colour| [colour.r, colour.g, colour.b]).collect()
}
