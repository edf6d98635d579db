// Khronos gltf-validator on one file: prints its report's issues as JSON. NODE_PATH names the folder of modules.
const fs = require("fs");
const validator = require("gltf-validator");
validator
  .validateBytes(new Uint8Array(fs.readFileSync(process.argv[2])), { maxIssues: 100 })
  .then((report) => console.log(JSON.stringify(report.issues)));
