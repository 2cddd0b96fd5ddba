"""A way to a listening program, through which connections to it go, and which can be hurt."""
import asyncio
import contextlib

SLICE_S = 0.05  # of a throttled connection's time


class Link:
    """Listens at `listen` and passes bytes on to `target`, both (host, port). The harness sets its faults:
    down        nothing passes, and connections wait without a word; with `refuse` new connections are refused
    rate        bytes a second, each way and connection; None: no limit
    delay_s     before each piece of data
    cut()       ends every connection in the middle of its next piece of data
    flip        chance for each piece of data that one bit of it changes"""

    def __init__(self, name, listen, target, random, rate=None, comes_from=None):
        """`comes_from`: the host that the target sees connections come from."""
        self.name, self.listen, self.target, self.random = name, listen, target, random
        self.comes_from = (comes_from, 0) if comes_from else None
        self.usual_rate = self.rate = rate
        self.delay_s, self.flip = 0, 0
        self.bytes, self.flipped, self.cuts = 0, 0, 0
        self._up = asyncio.Event()
        self._up.set()
        self._server, self._pairs, self._tasks = None, set(), set()

    async def open(self):
        self._server = await asyncio.start_server(self._accepted, *self.listen, limit=1 << 16)

    async def _shut_door(self):
        if self._server:
            self._server.close()
            self._server = None

    async def close(self):
        await self._shut_door()
        for task in list(self._tasks):
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)

    @contextlib.asynccontextmanager
    async def down(self, refuse):
        self._up.clear()
        if refuse:
            await self._shut_door()
        try:
            yield
        finally:
            self._up.set()
            if not self._server:
                await self.open()

    def cut(self):
        """Ends every connection there is within its next piece of data, perhaps before the first byte."""
        self.cuts += len(self._pairs)
        for pair in self._pairs:
            pair.cut = True

    async def _accepted(self, reader, writer):
        task = asyncio.current_task()
        self._tasks.add(task)
        pair = _Pair(self, reader, writer)
        try:
            await self._up.wait()
            await pair.run()
        except (OSError, asyncio.TimeoutError, asyncio.CancelledError):
            pass  # the connection has ended, by close() too
        finally:
            self._pairs.discard(pair)
            self._tasks.discard(task)
            pair.abort()

    async def wait_up(self):
        await self._up.wait()


class _Pair:
    """A connection and its continuation."""

    def __init__(self, link, reader, writer):
        self.link, self.reader, self.writer = link, reader, writer
        self.cut = False
        self.writers = [writer]

    async def run(self):
        reader, writer = await asyncio.open_connection(*self.link.target, limit=1 << 16, local_addr=self.link.comes_from)
        self.writers.append(writer)
        self.link._pairs.add(self)
        pumps = [asyncio.create_task(self._pump(self.reader, writer)), asyncio.create_task(self._pump(reader, self.writer))]
        try:
            await asyncio.gather(*pumps)
        finally:
            for pump in pumps:
                pump.cancel()
            await asyncio.gather(*pumps, return_exceptions=True)

    async def _pump(self, reader, writer):
        link = self.link
        while data := await reader.read(65536):
            await link.wait_up()
            if link.delay_s:
                await asyncio.sleep(link.delay_s)
            if self.cut:
                writer.write(data[:link.random.randrange(len(data))])
                await asyncio.wait_for(writer.drain(), 1)
                raise ConnectionAbortedError
            if link.random.random() < link.flip:
                at = link.random.randrange(len(data))
                data = data[:at] + bytes([data[at] ^ (1 << link.random.randrange(8))]) + data[at + 1:]
                link.flipped += 1
            await self._forward(data, writer)
        await link.wait_up()  # a farewell does not pass either
        writer.write_eof()

    async def _forward(self, data, writer):
        at = 0
        while at < len(data):
            rate = self.link.rate
            step = max(1, int(rate * SLICE_S)) if rate else len(data)
            writer.write(data[at:at + step])
            await writer.drain()
            self.link.bytes += len(data[at:at + step])
            at += step
            if rate:
                await asyncio.sleep(SLICE_S * len(data[at - step:at]) / step)
            await self.link.wait_up()

    def abort(self):
        for writer in self.writers:
            with contextlib.suppress(OSError):
                writer.transport.abort()
