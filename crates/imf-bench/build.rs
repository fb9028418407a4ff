//! Turns `IMF_NO_GPU_TESTS=1` into the cfg `no_gpu_tests`, so that the test runner itself reports the tests that need an
//! adapter as ignored.

fn main() {
    println!("cargo::rustc-check-cfg=cfg(no_gpu_tests)");
    println!("cargo::rerun-if-env-changed=IMF_NO_GPU_TESTS");
    if std::env::var("IMF_NO_GPU_TESTS").is_ok_and(|value| value == "1") {
        println!("cargo::rustc-cfg=no_gpu_tests");
    }
}
