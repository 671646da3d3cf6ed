"""A hub on 127.0.0.1 for tests: in memory, speaking as much of the hub's HTTP interface as pushing and loading need.

``LocalHub`` serves on a free port while it is used as a context manager. ``fail`` makes chosen requests fail, so that
what a client does about it can be tested.
"""

from __future__ import annotations

import base64
import hashlib
import json
import re
import threading
from collections.abc import Callable
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from urllib.parse import unquote, urlsplit

import yaml

TOKEN = "hf_localtesttoken"
LFS_SUFFIXES = (".mp4", ".parquet", ".safetensors", ".jpg")


@dataclass
class Repository:
    """Branches and tags point at commits; a commit is {path: content}."""

    private: bool
    commits: dict[str, dict[str, bytes]] = field(default_factory=dict)
    branches: dict[str, str] = field(default_factory=dict)
    tags: dict[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.commit("main", {})

    def commit(self, branch: str, files: dict[str, bytes]) -> str:
        text = f"{branch}{len(self.commits)}" + "".join(f"{p}{len(c)}" for p, c in sorted(files.items()))
        sha = hashlib.sha1(text.encode()).hexdigest()
        self.commits[sha] = files
        self.branches[branch] = sha
        return sha

    def find(self, revision: str) -> str | None:
        for names in (self.branches, self.tags):
            if revision in names:
                return names[revision]
        return revision if revision in self.commits else None

    def files(self, revision: str = "main") -> dict[str, bytes]:
        return self.commits[self.find(revision)]


class Answer(Exception):
    """Raised by a route to answer."""

    def __init__(self, status: int, content: object = None, *, code: str = "", raw: bytes | None = None, **headers):
        self.status, self.headers = status, {name.replace("_", "-"): value for name, value in headers.items()}
        if code:
            self.headers |= {"X-Error-Code": code, "X-Error-Message": code}
            content = {"error": code}
        self.body = raw if raw is not None else json.dumps({} if content is None else content).encode()
        self.headers.setdefault("Content-Type", "application/json")


class LocalHub:
    """The hub.

    Attributes:
        repositories: {(kind, "user/name"): Repository}, kind being dataset, model or space.
        blobs: {sha256: content} of what was uploaded to large-file storage.
        requests: "METHOD path" of every request, in order.
        fail: called with method and path before anything else; what it returns is done: None nothing, "drop" closes the
            connection without an answer, a number answers with that status.
    """

    def __init__(self) -> None:
        self.repositories: dict[tuple[str, str], Repository] = {}
        self.blobs: dict[str, bytes] = {}
        self.requests: list[str] = []
        self.fail: Callable[[str, str], object] = lambda method, path: None
        self.lock = threading.Lock()

    def __enter__(self) -> LocalHub:
        handler = type("Handler", (_Handler,), {"hub": self})
        self.server = ThreadingHTTPServer(("127.0.0.1", 0), handler)
        self.url = f"http://127.0.0.1:{self.server.server_port}"
        threading.Thread(target=self.server.serve_forever, daemon=True).start()
        return self

    def __exit__(self, *_: object) -> None:
        self.server.shutdown()
        self.server.server_close()

    def repository(self, kind: str, name: str) -> Repository:
        found = self.repositories.get((kind, name))
        if found is None:
            raise Answer(404, code="RepoNotFound")
        return found

    # --- routes: each raises the answer -----------------------------------------------------------------------------

    def whoami(self, method: str, body: bytes) -> None:
        raise Answer(200, {"type": "user", "name": "test", "orgs": [], "auth": {"accessToken": {"role": "write"}}})

    def validate(self, method: str, body: bytes) -> None:
        raise Answer(200, {"errors": [], "warnings": []})

    def create(self, method: str, body: bytes) -> None:
        wanted = json.loads(body)
        key = (wanted.get("type") or "model", f"{wanted.get('organization') or 'test'}/{wanted['name']}")
        url = f"{self.url}/{'' if key[0] == 'model' else key[0] + 's/'}{key[1]}"
        if key in self.repositories:
            raise Answer(409, {"error": "exists", "url": url})
        self.repositories[key] = Repository(private=wanted.get("visibility") == "private")
        raise Answer(200, {"url": url, "name": key[1], "id": key[1]})

    def lfs_batch(self, method: str, body: bytes, kind: str | None, name: str) -> None:
        objects = []
        for wanted in json.loads(body)["objects"]:
            known = wanted["oid"] in self.blobs
            actions = {} if known else {"actions": {"upload": {"href": f"{self.url}/blobs/{wanted['oid']}"}}}
            objects.append({"oid": wanted["oid"], "size": wanted["size"], **actions})
        content = {"transfer": "basic", "objects": objects}
        raise Answer(200, content, Content_Type="application/vnd.git-lfs+json")

    def blob(self, method: str, body: bytes, oid: str) -> None:
        if hashlib.sha256(body).hexdigest() != oid:
            raise Answer(400, code="BadOid")
        self.blobs[oid] = body
        raise Answer(200)

    def preupload(self, method: str, body: bytes, kind: str, name: str, revision: str) -> None:
        files = [
            {
                "path": file["path"],
                "uploadMode": "lfs" if file["path"].endswith(LFS_SUFFIXES) else "regular",
                "shouldIgnore": False,
                "oid": None,
            }
            for file in json.loads(body)["files"]
        ]
        raise Answer(200, {"files": files})

    def commit(self, method: str, body: bytes, kind: str, name: str, revision: str) -> None:
        repository = self.repository(kind, name)
        head = repository.find(revision)
        if head is None:
            raise Answer(404, code="RevisionNotFound")
        files = dict(repository.commits[head])
        for line in body.decode().splitlines():
            operation = json.loads(line) if line.strip() else {"key": ""}
            value = operation.get("value")
            if operation["key"] == "file":
                coded = value.get("encoding") == "base64"
                files[value["path"]] = base64.b64decode(value["content"]) if coded else value["content"].encode()
            elif operation["key"] == "lfsFile":
                files[value["path"]] = self.blobs[value["oid"]]
            elif operation["key"] == "deletedFile":
                files.pop(value["path"], None)
        sha = repository.commit(revision, files)
        url = f"{self.url}/{kind}s/{name}/commit/{sha}" if kind != "model" else f"{self.url}/{name}/commit/{sha}"
        raise Answer(200, {"success": True, "commitOid": sha, "commitUrl": url, "hookOutput": ""})

    def refs(self, method: str, body: bytes, kind: str, name: str) -> None:
        repository = self.repository(kind, name)
        listed = {
            what: [{"name": n, "ref": f"refs/{where}/{n}", "targetCommit": sha} for n, sha in held.items()]
            for what, where, held in (
                ("branches", "heads", repository.branches),
                ("tags", "tags", repository.tags),
            )
        }
        raise Answer(200, listed | {"converts": []})

    def reference(self, method: str, body: bytes, kind: str, name: str, what: str, which: str) -> None:
        repository = self.repository(kind, name)
        held = repository.tags if what == "tag" else repository.branches
        if method == "DELETE":
            if held.pop(which, None) is None:
                raise Answer(404, code="RevisionNotFound")
            raise Answer(200)
        wanted = json.loads(body or b"{}")
        new = wanted["tag"] if what == "tag" else which
        target = repository.find(which if what == "tag" else wanted.get("startingPoint") or "main")
        if new in held:
            raise Answer(409, {"error": "exists"})
        if target is None:
            raise Answer(404, code="RevisionNotFound")
        held[new] = target
        raise Answer(200)

    def info(self, method: str, body: bytes, kind: str, name: str, revision: str | None = None) -> None:
        repository = self.repository(kind, name)
        sha = repository.find(revision or "main")
        if sha is None:
            raise Answer(404, code="RevisionNotFound")
        files = repository.commits[sha]
        card = None
        if files.get("README.md", b"").startswith(b"---"):
            card = yaml.safe_load(files["README.md"].decode().split("---")[1])
        raise Answer(
            200,
            {
                "_id": "0", "id": name, "sha": sha, "private": repository.private, "gated": False, "disabled": False,
                "downloads": 0, "likes": 0, "tags": (card or {}).get("tags", []), "cardData": card,
                "siblings": [{"rfilename": path} for path in files],
            },
        )  # fmt: skip

    def tree(self, method: str, body: bytes, kind: str, name: str, place: str) -> None:
        repository = self.repository(kind, name)
        revision, _, folder = place.partition("/")
        sha = repository.find(revision)
        if sha is None:
            raise Answer(404, code="RevisionNotFound")
        listed = []
        for path, content in repository.commits[sha].items():
            if path.startswith(folder):
                entry = {"type": "file", "path": path, "oid": _git_id(content), "size": len(content)}
                if path.endswith(LFS_SUFFIXES):
                    entry["lfs"] = {"oid": _sha256(content), "size": len(content), "pointerSize": 130}
                listed.append(entry)
        raise Answer(200, listed)

    def resolve(self, method: str, body: bytes, kind: str | None, name: str, revision: str, path: str) -> None:
        repository = self.repository(kind or "model", name)
        sha = repository.find(revision)
        if sha is None:
            raise Answer(404, code="RevisionNotFound")
        if path not in repository.commits[sha]:
            raise Answer(404, code="EntryNotFound")
        content = repository.commits[sha][path]
        tag = _sha256(content) if path.endswith(LFS_SUFFIXES) else _git_id(content)
        raise Answer(
            200, raw=content, Content_Type="application/octet-stream", ETag=f'"{tag}"', X_Repo_Commit=sha,
            Accept_Ranges="bytes",
        )  # fmt: skip


ROUTES = [
    (r"/api/whoami-v2", "whoami"),
    (r"/api/validate-yaml", "validate"),
    (r"/api/repos/create", "create"),
    (r"/blobs/(\w{64})", "blob"),
    (r"/(?:(dataset|space)s/)?([^/]+/[^/]+)\.git/info/lfs/objects/batch", "lfs_batch"),
    (r"/api/(model|dataset|space)s/([^/]+/[^/]+)/preupload/(.+)", "preupload"),
    (r"/api/(model|dataset|space)s/([^/]+/[^/]+)/commit/(.+)", "commit"),
    (r"/api/(model|dataset|space)s/([^/]+/[^/]+)/refs", "refs"),
    (r"/api/(model|dataset|space)s/([^/]+/[^/]+)/(tag|branch)/(.+)", "reference"),
    (r"/api/(model|dataset|space)s/([^/]+/[^/]+)/tree/(.+)", "tree"),
    (r"/api/(model|dataset|space)s/([^/]+/[^/]+)/revision/(.+)", "info"),
    (r"/api/(model|dataset|space)s/([^/]+/[^/]+)", "info"),
    (r"/(?:(dataset|space)s/)?([^/]+/[^/]+)/resolve/([^/]+)/(.+)", "resolve"),
]


class _Handler(BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"
    hub: LocalHub

    def log_message(self, *_: object) -> None:
        pass

    def answer(self) -> None:
        path = unquote(urlsplit(self.path).path)
        length = int(self.headers.get("Content-Length") or 0)
        body = self.rfile.read(length)
        with self.hub.lock:
            self.hub.requests.append(f"{self.command} {path}")
            wanted = self.hub.fail(self.command, path)
            if wanted == "drop":
                self.close_connection = True
                self.connection.close()
                return
            answer = Answer(int(wanted), {"error": "made to fail"}) if wanted else self.route(path, body)
        self.send_response(answer.status)
        for name, value in (answer.headers | {"Content-Length": str(len(answer.body))}).items():
            self.send_header(name, value)
        self.end_headers()
        if self.command != "HEAD":
            self.wfile.write(answer.body)

    def route(self, path: str, body: bytes) -> Answer:
        public = path.startswith("/blobs/") or path == "/api/validate-yaml"
        if not public and self.headers.get("Authorization") != f"Bearer {TOKEN}":
            return Answer(401, {"error": "Invalid credentials in Authorization header"})
        for pattern, name in ROUTES:
            if found := re.fullmatch(pattern, path):
                try:
                    getattr(self.hub, name)(self.command, body, *found.groups())
                except Answer as answer:
                    return answer
        return Answer(404, {"error": f"no route {self.command} {path}"})

    do_GET = do_POST = do_PUT = do_DELETE = do_HEAD = answer


def _git_id(content: bytes) -> str:
    return hashlib.sha1(b"blob %d\0" % len(content) + content).hexdigest()


def _sha256(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()
