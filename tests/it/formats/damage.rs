//! Flipped bytes and cut files of formats with checksums: an error that names the file, or the identical
//! scenarios. Damage of the other formats: `conformance`.

use std::fs;
use std::path::Path;

use super::{digests, good, gzip};
use crate::small_scenarios::write;
use reactsim_test_support::proto::{self, Proto};

/// Reads a file with every `stride`-th byte changed, and cut at every `stride`-th byte.
fn hurt(path: &Path, stride: usize) {
    let data = fs::read(path).unwrap();
    let sound: Vec<String> = good(path).iter().map(|s| s.digest()).collect();
    let check = |what: &str| {
        let all = digests(path);
        let mut errors = 0;
        for one in &all {
            match one {
                Err(error) => {
                    errors += 1;
                    assert!(error.to_string().contains(&path.display().to_string()), "{what}: {error}");
                }
                Ok(digest) => assert!(sound.contains(digest), "{what}: another scenario"),
            }
        }
        assert!(errors > 0 || all.len() == sound.len(), "{what}: {} of {}, no error", all.len(), sound.len());
    };
    for (k, at) in (0..data.len()).step_by(stride).enumerate() {
        let mut bad = data.clone();
        bad[at] ^= [0x01, 0x80, 0xff][k % 3];
        fs::write(path, &bad).unwrap();
        check(&format!("byte {at} flipped"));
    }
    for length in (0..data.len()).step_by(stride) {
        fs::write(path, &data[..length]).unwrap();
        check(&format!("cut to {length}"));
    }
    let mut longer = data.clone();
    longer.extend(b"garbage behind the end");
    fs::write(path, longer).unwrap();
    assert!(digests(path).iter().any(Result::is_err), "garbage behind the end");
}

/// The next record is found behind a header that is damaged: one scenario is lost, and one is reported.
#[test]
fn a_damaged_header_costs_one_record() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("f.tfrecord");
    let records: Vec<Proto> =
        ["one", "two", "three", "four"].map(|id| Proto { id: id.into(), ..Proto::default() }).into();
    let plain = proto::records(&records);
    fs::write(&path, &plain).unwrap();
    let sound: Vec<String> = good(&path).iter().map(|s| s.digest()).collect();
    let second = proto::records(&records[..1]).len();
    for byte in [0, 3, 7, 8, 11] {
        let mut bad = plain.clone();
        bad[second + byte] ^= 0x10;
        fs::write(&path, &bad).unwrap();
        let read = digests(&path);
        assert_eq!(read.len(), 4, "byte {byte}");
        for (n, one) in read.into_iter().enumerate() {
            match one {
                Ok(digest) => assert!(n != 1 && digest == sound[n], "byte {byte}: {n}"),
                Err(error) => {
                    assert!(n == 1 && error.to_string().contains("record 1"), "byte {byte}: {error}")
                }
            }
        }
    }
}

#[test]
fn damaged_tfrecords() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("f.tfrecord");
    let two = [Proto::default(), Proto { id: "two".into(), ..Proto::default() }];
    fs::write(&path, proto::records(&two)).unwrap();
    hurt(&path, 301);
    let plain = proto::records(&two);
    for (name, content) in
        [("f.tfrecord.zst", zstd::encode_all(&plain[..], 1).unwrap()), ("f.tfrecord.gz", gzip(&plain))]
    {
        let path = folder.path().join(name);
        fs::write(&path, content).unwrap();
        hurt(&path, 17);
    }
}

#[test]
fn damaged_native_files() {
    let folder = tempfile::tempdir().unwrap();
    let (womd, path) = (folder.path().join("f.tfrecord"), folder.path().join("f.parquet"));
    let ten: Vec<Proto> = (0..10).map(|i| Proto { id: i.to_string(), ..Proto::default() }).collect();
    fs::write(&womd, proto::records(&ten)).unwrap();
    write(&path, good(&womd));
    fs::remove_file(&womd).unwrap();
    hurt(&path, 89);
}
