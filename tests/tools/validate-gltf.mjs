// Khronos' validator over files: prints every issue that is an error or a warning, exits with 1 when there is one.
//   NODE_PATH-like folder of packages in TESTS_NODE_TOOLS; validate-gltf.mjs FILE.glb ...
import { readFileSync } from 'node:fs';
import { createRequire } from 'node:module';

const validator = createRequire(`${process.env.TESTS_NODE_TOOLS}/`)('gltf-validator');
let bad = 0;
for (const file of process.argv.slice(2)) {
  const { issues } = await validator.validateBytes(new Uint8Array(readFileSync(file)), { maxIssues: 10000 });
  for (const m of issues.messages.filter((one) => one.severity <= 1)) console.log(`${file}: ${m.code} ${m.pointer ?? ''}: ${m.message}`);
  console.log(`${file}: ${issues.numErrors} errors, ${issues.numWarnings} warnings`);
  bad += issues.numErrors + issues.numWarnings;
}
process.exit(bad ? 1 : 0);
