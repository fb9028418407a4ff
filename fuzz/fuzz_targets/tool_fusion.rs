#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| imf_tests::readers::check("tool_fusion", bytes));
