//! Turns `IMF_NO_GPU_TESTS=1` and `IMF_NO_BROWSER_TESTS=1` into cfgs, so that the test runner itself reports the tests that need
//! an adapter or a browser as ignored.

fn main() {
    for (variable, cfg) in
        [("IMF_NO_GPU_TESTS", "no_gpu_tests"), ("IMF_NO_BROWSER_TESTS", "no_browser_tests")]
    {
        println!("cargo::rustc-check-cfg=cfg({cfg})");
        println!("cargo::rerun-if-env-changed={variable}");
        if std::env::var(variable).is_ok_and(|value| value == "1") {
            println!("cargo::rustc-cfg={cfg}");
        }
    }
}
