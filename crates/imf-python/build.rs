//! How the module is linked where the interpreter alone knows Python's symbols.

fn main() {
    pyo3_build_config::add_extension_module_link_args();
}
