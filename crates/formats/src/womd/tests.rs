use super::record::masked_crc;

#[test]
fn checksum_matches_tensorflow() {
    // The header of a record of 24 bytes, as TensorFlow writes it.
    assert_eq!(masked_crc(&24u64.to_le_bytes()).to_le_bytes(), [0xa3, 0x7f, 0x4b, 0x22]);
}
