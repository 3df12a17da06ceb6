-- KEYS: the record, its epoch, all records, the era. ARGV: the key, the value, the epoch or 0, milliseconds or 0.
-- Returns 1 and the epoch, or 0 and the epoch and value that stand.
local there = redis.call('HMGET', KEYS[1], 'epoch', 'value')
local epoch = ARGV[3]
if there[1] then
  if there[1] ~= epoch then return {0, there[1], there[2]} end
else
  local last = redis.call('GET', KEYS[2])
  if epoch == '0' then
    -- Another era's epochs are others, even where an engine has lost the last ones of the era before.
    local floor = tonumber(redis.call('GET', KEYS[4]) or 0) * 4294967296
    epoch = string.format('%.0f', math.max(tonumber(last or 0), floor) + 1)
  elseif epoch ~= last then
    return {0, '0', ''}
  end
end
redis.call('HSET', KEYS[1], 'epoch', epoch, 'value', ARGV[2])
local life = tonumber(ARGV[4])
if life > 0 then
  redis.call('PEXPIRE', KEYS[1], life)
  redis.call('SET', KEYS[2], epoch, 'PX', life + 86400000)  -- whoever held it is not heard a day after
else
  redis.call('PERSIST', KEYS[1])
  redis.call('SET', KEYS[2], epoch)
end
if redis.call('ZADD', KEYS[3], 0, ARGV[1]) == 1 then
  -- Names of records that have ended go, two for each that comes.
  for _, key in ipairs(redis.call('ZRANDMEMBER', KEYS[3], 3)) do
    if redis.call('EXISTS', string.sub(KEYS[1], 1, #KEYS[1] - #ARGV[1]) .. key) == 0 then redis.call('ZREM', KEYS[3], key) end
  end
end
return {1, epoch, ''}
