// mikronode as its page shows it: a device, login, channels; `write` on a channel gives a promise of the answer.
'use strict';

const fs = require('fs');
const MikroNode = require('mikronode');

const job = JSON.parse(process.argv[2]);
const FILTER = '/ip/firewall/filter';

async function open() {
  const device = new MikroNode(job.host, job.port);
  device.TLS({ ca: fs.readFileSync(job.ca), checkServerIdentity: () => undefined, rejectUnauthorized: true });
  const [login] = await device.connect();
  return login(job.user, job.password);
}

// One command on a channel of its own: its rows, what `!done` brought, or the message of a trap.
let channels = 0;
async function call(connection, command, words) {
  channels += 1;
  const channel = connection.openChannel(`channel${channels}`, false);
  try {
    return (await channel.write(command, words)).data.map((row) => (Array.isArray(row) ? MikroNode.resultsToObj(row) : row));
  } catch (trap) {
    throw new Error(MikroNode.resultsToObj(trap.data).message);
  } finally {
    channel.close();
  }
}

const doings = {
  // Every menu, a few channels at a time.
  async read(connection) {
    const told = {};
    for (let start = 0; start < job.menus.length; start += 8) {
      const some = job.menus.slice(start, start + 8);
      const answers = await Promise.all(some.map((menu) => call(connection, `${menu}/print`)));
      some.forEach((menu, index) => { told[menu] = answers[index]; });
    }
    return told;
  },

  async queries(connection) {
    const icmp = await call(connection, `${FILTER}/print`, ['=.proplist=comment', '?chain=input', '?protocol=icmp']);
    return { and: icmp.map((row) => row.comment), len: (await call(connection, `${FILTER}/print`)).length };
  },

  async refused(connection) {
    const told = [];
    for (const [command, words] of job.calls) {
      const sent = call(connection, command, Object.entries(words).map(([name, value]) => `=${name}=${value}`));
      told.push(await sent.then(() => 'accepted', (refusal) => refusal.message));
    }
    return told;
  },

  async words(connection) {
    const told = [];
    const menu = '/ip/firewall/address-list';
    for (const text of job.texts) {
      const row = { list: 'words', address: '192.0.2.77', comment: text };
      const [ret] = await call(connection, `${menu}/add`, row);
      const [found] = await call(connection, `${menu}/print`, [`?.id=${ret}`]);
      told.push(found.comment === undefined ? '' : found.comment);
      await call(connection, `${menu}/remove`, { '.id': ret });
    }
    return told;
  },

  async tamper(connection) {
    const one = async (menu, comment) => (await call(connection, `${menu}/print`, [`?comment=${comment}`]))[0]['.id'];
    const rule = { chain: 'input', action: 'accept', comment: job.added, 'src-address': '10.9.9.9' };
    const [ret] = await call(connection, `${FILTER}/add`, rule);
    const address = await one('/ip/address', job.renamed);
    await call(connection, '/ip/address/set', { '.id': address, comment: job.comment });
    await call(connection, '/ip/dns/static/remove', { '.id': await one('/ip/dns/static', job.removed) });
    const order = { numbers: await one(FILTER, job.moved), destination: await one(FILTER, job.before) };
    await call(connection, `${FILTER}/move`, order);
    return ret;
  },
};

async function main() {
  if (job.do === 'nothing') {
    // What it does where a print has no rows: with `!empty` it complains aloud, and the promise never settles.
    const complaints = [];
    console.error = (...words) => complaints.push(words.join(' '));
    const waited = new Promise((resolve) => { setTimeout(resolve, 2000, { failed: complaints }); });
    const asked = call(await open(), '/queue/simple/print').then((rows) => ({ rows }));
    console.log(JSON.stringify(await Promise.race([asked, waited])));
    process.exit(0);
  }
  if (job.do === 'login') {
    job.password = 'guessed';
    const told = await open().then(() => 'accepted', (trap) => MikroNode.resultsToObj(trap).message);
    console.log(JSON.stringify({ wrong: told }));
  } else {
    console.log(JSON.stringify(await doings[job.do](await open())));
  }
  process.exit(0);
}

main().catch((failure) => {
  console.error(failure);
  process.exit(1);
});
