//! What a process is made from, in; whether another one may work with it, and where they differ, out.

use koehler::engine::CODE;
use tonic::metadata::MetadataMap;
use tonic::{Request, Status};

/// Under this name a process says in every call what it is.
const PROGRAM: &str = "koehler-cluster";
const PARTS: [&str; 4] = ["code version", "cluster version", "target", "fused multiply-add"];

/// What has to be the same in all processes, in the order of `PARTS`.
fn parts() -> [String; 4] {
    let target = format!("{}-{}", std::env::consts::ARCH, std::env::consts::OS);
    [CODE.into(), env!("CLUSTER_CODE").into(), target, if fuses() { "yes" } else { "no" }.into()]
}

/// Functions of the mathematics library and native code of models round otherwise with it.
fn fuses() -> bool {
    #[cfg(target_arch = "x86_64")]
    return std::arch::is_x86_feature_detected!("fma");
    #[cfg(not(target_arch = "x86_64"))]
    return cfg!(target_arch = "aarch64");
}

/// What this process says of itself in every call.
pub fn said() -> String {
    format!("{PROGRAM}/{}", parts().join(":"))
}

/// Where another process differs from this one.
fn difference(said: &str) -> Option<String> {
    let first = said.split(' ').next().and_then(|first| first.strip_prefix(PROGRAM));
    let theirs = first.and_then(|rest| rest.strip_prefix('/'));
    let Some(theirs) = theirs else { return Some("it is no koehler-cluster".into()) };
    let theirs: Vec<&str> = theirs.split(':').collect();
    let ours = parts();
    if theirs.len() != ours.len() {
        return Some("it is of another version".into());
    }
    let differ = |((name, ours), theirs): ((&str, &String), &str)| {
        (ours != theirs).then(|| format!("{name} is {theirs} there and {ours} here"))
    };
    let all: Vec<String> = PARTS.into_iter().zip(&ours).zip(theirs).filter_map(differ).collect();
    (!all.is_empty()).then(|| all.join(", "))
}

/// Refuses a call of a process that is not the same program on the same kind of machine.
///
/// # Errors
/// It is not.
pub fn check(metadata: &MetadataMap) -> Result<(), Status> {
    let said = metadata.get("user-agent").and_then(|value| value.to_str().ok()).unwrap_or_default();
    match difference(said) {
        None => Ok(()),
        Some(why) => Err(Status::failed_precondition(format!(
            "refused: {why}; use one build of koehler-cluster, on machines of one kind"
        ))),
    }
}

/// `check`, in front of a service.
///
/// # Errors
/// Those of `check`.
pub fn intercept(request: Request<()>) -> Result<Request<()>, Status> {
    check(request.metadata()).map(|()| request)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_part_counts() {
        let ours = parts();
        assert_eq!(difference(&format!("koehler-cluster/{} tonic/0.14", ours.join(":"))), None);
        assert!(difference("grpc-python/1").is_some_and(|why| why.contains("no koehler-cluster")));
        for i in 0..ours.len() {
            let mut theirs = ours.clone();
            theirs[i] = "other".into();
            let why = difference(&format!("koehler-cluster/{}", theirs.join(":")));
            assert!(why.is_some_and(|why| why.starts_with(PARTS[i])));
        }
    }
}
